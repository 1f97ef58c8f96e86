"""Mutants behind switches: one copy of the workspace has all of them, and `DAPPLE_MUTANT` turns one on.

A draw takes mutants in proportion to the lines of each crate, throws out those that do not compile, and runs for each the tests that
reach it, quickest first. `--caught` looks up each mutant of `.ci/mutants-caught.tsv` by crate, function and text, wherever its file is now,
and runs the test that caught it, then the others.
"""

import argparse
import os
import random
import re
import sys
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

from plant import Copy
from run import Program, State, baseline, groups, listed, run
from sites import all_sites, crates, locate

CAUGHT, MISSED = Path(".ci/mutants-caught.tsv"), Path(".ci/mutants-missed.tsv")
COLUMNS = ["crate", "function", "kind", "original", "mutated", "ordinal"]
WEIGHTS = {"operator": 40, "body": 20, "number": 20, "call": 10, "not": 5, "guard": 5}
# Programs that render images by all crates, in the order in which they are tried, and their processor seconds for one mutant.
WHOLE = {"dapple": 30.0, "cli": 20.0, "golden": 60.0}
# Processor seconds of one mutant's tests: of its own crate, and of others but `WHOLE`.
OWN, OTHERS = 60.0, 10.0
# Tests that take longer without a mutant are not run.
LONGEST, LONGEST_WHOLE = 40.0, 400.0
# The load above which one mutant is run at a time.
BUSY = 5.0
CUT = "survived the quicker tests"


def say(message):
    print(f"[{time.strftime('%H:%M:%S')}] {message}", flush=True)


def candidates(sites, lines, number, seed):
    """For each crate its share of the draw, and its mutants in the order in which they are taken."""
    total = sum(lines.values())
    exact = {c: number * n / total for c, n in lines.items()}
    share = {c: int(e) for c, e in exact.items()}
    for c in sorted(exact, key=lambda c: share[c] - exact[c])[: number - sum(share.values())]:
        share[c] += 1
    for crate in sorted(share):
        rng = random.Random(f"{seed} {crate}")
        pools = defaultdict(list)
        for site in sites:
            if site.crate == crate:
                pools[site.kind].append(site)
        for pool in pools.values():
            rng.shuffle(pool)
        order, places = [], set()
        while any(pools.values()) and len(order) < 2 * share[crate] + 6:
            kinds = [k for k in WEIGHTS if pools[k]]
            site = pools[rng.choices(kinds, [WEIGHTS[k] for k in kinds])[0]].pop()
            if (site.file, site.start) not in places:
                places.add((site.file, site.start))
                order.append(site)
        yield crate, share[crate], order


def draw(copy, sites, lines, number, seed):
    """The mutants of a draw that compile, and by crate the number of those thrown out before the last of them."""
    drawn = list(candidates(sites, lines, number, seed))
    pool = dict(enumerate((s for _, _, order in drawn for s in order), 1))
    packages = [f"dapple-{c}" for c, _, _ in drawn]
    alive = dict(pool)
    while True:
        copy.plant(alive)
        broken = copy.broken(packages)
        say(f"{len(alive)} mutants, of which {len(broken)} do not compile")
        if not broken:
            break
        alive = {n: s for n, s in alive.items() if n not in broken}
    chosen, thrown = [], {}
    compiles = {id(s) for s in alive.values()}
    for crate, share, order in drawn:
        good = [i for i, s in enumerate(order) if id(s) in compiles][:share]
        if len(good) < share:
            say(f"{crate}: {len(good)} of {share}")
        thrown[crate] = good[-1] + 1 - len(good) if good else 0
        chosen += [order[i] for i in good]
    return chosen, thrown


def read_list(path):
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [line.split("\t") for line in lines]


def write_list(path, head, rows):
    path.write_text("\n".join([*(f"# {h}" for h in head), *("\t".join(r) for r in sorted(rows))]) + "\n")


class Runner:
    """Runs the tests of each mutant and keeps what is known in the state."""

    def __init__(self, programs, dependents, state, scenes):
        self.programs, self.dependents, self.state, self.lock = programs, dependents, state, threading.Lock()
        self.claimed = {}
        self.variables = {"DAPPLE_SCENES": scenes} if scenes else {}
        self.baselines = state.data.setdefault("baseline", {})
        self.results = state.data.setdefault("results", {})

    def measure(self, tests):
        """Runs tests without a mutant that were not run so yet; threads share the work."""
        while True:
            with self.lock:
                left = [t for t in tests if self.name(*t) not in self.baselines | self.claimed]
                if left:
                    program, test = left[0]
                    self.claimed[self.name(program, test)] = True
            if not left:
                break
            known = baseline(program, test, LONGEST_WHOLE if program.name == "golden" else LONGEST, self.variables)
            with self.lock:
                self.baselines[self.name(program, test)] = known
        while any(self.name(*t) not in self.baselines for t in tests):
            time.sleep(0.5)

    @staticmethod
    def name(program, test):
        return f"{program.label()} {test}"

    def reaching(self, number, programs):
        """The tests that pass without mutants and reach this one: `(program, test, seconds)`."""
        return self.of_these(number, [(program, test) for program in programs for test in self.programs[program]])

    def of_these(self, number, tests):
        self.measure(tests)
        known = [(*t, self.baselines[self.name(*t)]) for t in tests]
        return [(program, test, k["seconds"]) for program, test, k in known if not k["failed"] and number in k["seen"]]

    def attempt(self, number, tests, budget):
        """Runs groups of tests until one fails or the budget is spent: `(program, test, how, seconds)`."""
        spent = 0.0
        for program, names, seconds in groups(tests):
            if spent and spent + seconds > budget:
                return None, "", "budget", spent
            failed, how, used = run(program, names, self.variables | {"DAPPLE_MUTANT": str(number)}, 5 * seconds + 5)
            spent += used
            if how:
                return program, failed, how, spent
        return None, "", "", spent

    def tests_of(self, stage, number, site, killer):
        """The tests of one stage, and the processor seconds that they may take."""
        if stage == "killer":
            return self.reaching_by(number, killer) if killer else [], 1e9
        if stage == "own":
            return self.reaching(number, [p for p in self.programs if p.crate == site.crate]), OWN
        if stage == "dependents":
            return self.reaching(number, [p for p in self.programs if p.crate in self.dependents[site.crate]]), OTHERS
        return self.reaching(number, [p for p in self.programs if p.name == stage]), WHOLE[stage]

    def attempt_stage(self, stage, number, site, killer):
        """One stage of a mutant that nothing has caught yet."""
        known = self.results.get(self.key(site), {"caught": False, "tried": [], "how": "not reached", "seconds": 0.0})
        tests, budget = self.tests_of(stage, number, site, killer)
        program, test, how, spent = self.attempt(number, tests, budget)
        known = known | {"tried": [*known["tried"], stage], "seconds": round(known["seconds"] + spent, 1)}
        if program:
            return known | {"caught": True, "program": program.label(), "test": test, "how": how}
        if how == "budget" or known["how"] == CUT:
            return known | {"how": CUT}
        return known | {"how": "survived" if tests else known["how"]}

    def reaching_by(self, number, killer):
        """The test that caught a mutant: where it was, else one of its name elsewhere."""
        label, name = killer
        last = name.rsplit("::", 1)[-1]
        known = [(p, t) for p, tests in self.programs.items() for t in tests if t.rsplit("::", 1)[-1] == last]
        known.sort(key=lambda k: (k[0].label() != label, k[1] != name))
        return self.of_these(number, known[:1])

    def all(self, sites, killers, jobs):
        """The known killer of each mutant, then its crate's own tests, then whole images, then tests of crates that use it."""
        for stage in [*(["killer"] if killers else []), "own", *WHOLE, "dependents"]:
            self.all_of(stage, sites, killers, jobs)

    def all_of(self, stage, sites, killers, jobs):
        """One stage of all mutants that are not caught; a second at the same time only where the machine is idle."""
        known = lambda n: self.results.get(self.key(sites[n]), {"caught": False, "tried": []})
        left = [n for n in sites if not known(n)["caught"] and stage not in known(n)["tried"]]
        # Baselines are taken once they are needed, so mutants of a crate follow one another.
        left.sort(key=lambda n: (sites[n].crate, n))
        say(f"{stage}: {len(left)} mutants")

        def work(second):
            while True:
                while second and os.getloadavg()[0] > BUSY and left:
                    time.sleep(20)
                with self.lock:
                    if not left:
                        return
                    number = left.pop() if second else left.pop(0)
                result = self.attempt_stage(stage, number, sites[number], killers.get(number))
                with self.lock:
                    self.results[self.key(sites[number])] = result
                    self.state.save()
                site, by = sites[number], f"{result['program']} {result['test']}" if result["caught"] else ""
                say(f"{len(left)} left | {site.crate} {site.function} {site.kind}: {site.mutated or 'no ' + site.original} | {result['how']} {by}")

        threads = [threading.Thread(target=work, args=(i > 0,)) for i in range(jobs)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()

    @staticmethod
    def key(site):
        return "\t".join(site.identity())


def built(copy, crate_names):
    """The test programs of the sample's crates and of the facade, with the names of their tests."""
    names = list(WHOLE)
    for crate, folder in crates(copy.root):
        if crate in crate_names:
            main = (folder / "tests" / crate / "main.rs").exists()
            names += [crate] if main else [p.stem for p in folder.glob("tests/*.rs")]
    packages = ["dapple", "dapple-cli", *(f"dapple-{c}" for c in sorted(crate_names))]
    programs = {}
    for crate, name, unit, executable, folder in copy.build(packages, names):
        program = Program(crate, "unit" if unit else name, executable, folder)
        programs[program] = listed(program)
        say(f"{program.label()}: {len(programs[program])} tests")
    return programs


def dependents_of(root, lines):
    """For each crate the three smallest of those that use it."""
    uses = {c: folder.joinpath("Cargo.toml").read_text().split("[dependencies]")[-1].split("\n[")[0] for c, folder in crates(root)}
    using = lambda c: [d for d in lines if re.search(rf"^dapple-{c} ", uses[d], re.M)]
    return {c: sorted(using(c), key=lambda d: lines[d])[:3] for c in uses}


def checked_killers(runner, sites):
    """Tests that fail now and then without mutants catch nothing: the killers once more."""
    by_label = {p.label(): p for p in runner.programs}
    killers = {(r["program"], r["test"]) for r in runner.results.values() if r["caught"]}
    bad = set()
    for label, test in sorted(killers):
        runner.measure([(by_label[label], test)])
        known = runner.baselines[f"{label} {test}"]
        failed, how, _ = run(by_label[label], [test], runner.variables, 5 * known["seconds"] + 5)
        if how:
            say(f"fails without a mutant: {label} {test} ({how})")
            bad.add((label, test))
    for label, test in bad:
        runner.baselines[f"{label} {test}"]["failed"] = "now and then"
    again = [k for k, r in runner.results.items() if r["caught"] and (r["program"], r["test"]) in bad]
    for key in again:
        del runner.results[key]
    runner.state.save()
    return bool(again)


def table(sites, results, thrown):
    rows = defaultdict(Counter)
    for site in sites.values():
        result = results[Runner.key(site)]
        rows[site.crate]["caught" if result["caught"] else "not reached" if result["how"] == "not reached" else "survived"] += 1
    print(f"{'crate':18} caught survived not-reached thrown-out")
    for crate in sorted(rows):
        r = rows[crate]
        print(f"{crate:18} {r['caught']:6} {r['survived']:8} {r['not reached']:11} {thrown.get(crate, 0):10}")
    total = sum(rows.values(), Counter())
    print(f"{'all':18} {total['caught']:6} {total['survived']:8} {total['not reached']:11} {sum(thrown.values()):10}")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--draw", type=int, metavar="N", help="draws N mutants and writes the lists of the caught and of the missed")
    parser.add_argument("--caught", action="store_true", help="fails if a mutant of the list of the caught survives")
    parser.add_argument("--write", action="store_true", help="with --caught: writes the list with present places and killers, without what is gone")
    parser.add_argument("--seed", type=int, default=56)
    parser.add_argument("--crates", default="", help="crates to draw from, with commas (default: all)")
    parser.add_argument("--exclude", default="", help="files to leave out, as crate/path with * and commas, such as core/exchange*,cli/*")
    parser.add_argument("--folder", default="/tmp/dapple-mutants", help="the copy of the workspace, with its target folder")
    parser.add_argument("--state", help="file of results, by which a run that was stopped is resumed (default: FOLDER.json)")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at the same time; more than one only while the load is below 4")
    parser.add_argument("--build-jobs", type=int, default=2)
    options = parser.parse_args()
    if bool(options.draw) == options.caught:
        parser.error("one of --draw N and --caught")
    return options


def main():
    options = arguments()
    sys.setrecursionlimit(20000)
    os.nice(max(0, 19 - os.nice(0)))
    root = Path.cwd()
    scenes = os.environ.get("DAPPLE_SCENES") or next((str(p) for p in [(root / "../shared/scenes").resolve()] if p.is_dir()), "")
    state = State(options.state or f"{options.folder}.json")
    copy = Copy(root, options.folder, options.build_jobs)
    started = time.monotonic()
    excluded = [e for e in options.exclude.split(",") if e]
    names = {c for c in options.crates.split(",") if c}
    killers, listed_rows, thrown = {}, [], {}
    if options.draw:
        command = f"{copy.code()}: draw {options.draw} {options.seed} {sorted(names)} {excluded}"
        sites, lines = all_sites(root, names, excluded)
        if state.data.get("command") != command:
            chosen, thrown = draw(copy, sites, lines, options.draw, options.seed)
            state.data = {"command": command, "mutants": [s.identity() for s in chosen], "thrown": thrown}
            state.save()
        places = locate([tuple(i) for i in state.data["mutants"]], sites)
        thrown = state.data["thrown"]
        planted = {n: site for n, (site, _) in enumerate(places, 1)}
    else:
        listed_rows = read_list(CAUGHT)
        sites, lines = all_sites(root)
        places = locate([tuple(r[:6]) for r in listed_rows], sites)
        planted = {n: site for n, (site, _) in enumerate(places, 1) if site}
        killers = {n: tuple(listed_rows[n - 1][6:8]) for n in planted}
        while True:
            copy.plant(planted)
            broken = copy.broken(sorted({f"dapple-{s.crate}" for s in planted.values()}))
            if not broken:
                break
            planted = {n: s for n, s in planted.items() if n not in broken}
        command = f"{copy.code()}: caught {[s.identity() for s in planted.values()]}"
        if state.data.get("command") != command:
            state.data = {"command": command}
    copy.plant(planted)
    crate_names = {s.crate for s in planted.values()} if options.caught or names else {
        c for c, _ in crates(root) if any(s.crate == c for s in planted.values())
    }
    # What joins films is tested there.
    crate_names.add("distributed")
    programs = built(copy, crate_names)
    say(f"built {(time.monotonic() - started) / 60:.1f} minutes after the start")
    runner = Runner(programs, dependents_of(root, {c: n for c, n in lines.items() if c in crate_names}), state, scenes)
    runner.all(planted, killers, options.jobs)
    while checked_killers(runner, planted):
        runner.all(planted, killers, options.jobs)
    results = runner.results
    table(planted, results, thrown)
    say(f"{(time.monotonic() - started) / 60:.1f} minutes")
    row = lambda site: (*site.identity(), *(results[Runner.key(site)].get(k, "") for k in ("program", "test")))
    caught = [row(s) for s in planted.values() if results[Runner.key(s)]["caught"]]
    missed = [(*s.identity(), results[Runner.key(s)]["how"]) for s in planted.values() if not results[Runner.key(s)]["caught"]]
    if options.draw:
        given = f".ci/mutants_sample --draw {options.draw} --seed {options.seed}" + (f" --crates {options.crates}" if names else "")
        given += f" --exclude '{options.exclude}'" if excluded else ""
        head = f"{len(caught)} caught and {len(missed)} missed of the mutants of `{given}`."
        write_list(CAUGHT, ["Mutants that a test catches; `.ci/mutants_sample --caught` runs them again.", head, "\t".join([*COLUMNS, "program", "test"])], caught)
        write_list(MISSED, ["Mutants that no test catches.", head, "\t".join([*COLUMNS, "why"])], missed)
        return 0
    lost = [n for n in range(1, len(places) + 1) if n not in planted]
    for n in lost:
        print("gone:", *listed_rows[n - 1][:5], sep="\t")
    for n, (site, how) in enumerate(places, 1):
        if n in planted and how == "moved":
            print("moved:", *listed_rows[n - 1][:2], "to", site.crate, site.function, site.mutated, sep="\t")
    for r in missed:
        print("SURVIVES:", *r, sep="\t")
    print(f"{len(caught)} caught, {len(missed)} survive, the code of {len(lost)} is gone")
    if options.write:
        head = [line.removeprefix("# ") for line in CAUGHT.read_text().splitlines() if line.startswith("#")]
        kept = [tuple(listed_rows[n - 1]) for n in planted if not results[Runner.key(planted[n])]["caught"]]
        write_list(CAUGHT, head, caught + kept)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
