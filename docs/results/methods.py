#!/usr/bin/env python3
"""methods.py [--add] TABLES VERDICTS RUNS.JSONL...: the errors of every method over those of uniform sampling, from the runs of its studies.

With --add, the runs are of methods that the committed TABLES/methods.csv lacks, and its rows stay. The runs must hold the baselines
of their methods, on the same scenes, with the same budgets, seeds and resolutions; methods.toml has them. Baselines that the table
has already are compared with it, and not written again.

Writes TABLES/methods.csv and VERDICTS (crates/registry/src/verdicts.tsv), and prints the tables of methods.md.

At equal samples, errors are compared as they are. At equal time, a sampler gets the CPU seconds that uniform sampling with the same
filter takes for 32 spp, a filter or point set those of uniform sampling without one. Its time is a line through its own two
budgets, its error a power of the samples through the same two. A scene where this gives less than 1 spp is left out of the
figure, and counted. One row per scene and method, then geometric means over scenes
("all", "tuned", "held out"). Errors are means over seeds; 95 % intervals come from resamplings of the seeds, the same for all methods and scenes.
"""
import csv
import json
import math
import os
import random
import sys

# Scenes that settings of the default were chosen on, or that were looked at meanwhile.
TUNED = ["cornell", "room", "glass", "lens", "door", "tea"]
BASE = "uniform/sobol/none"


def read(paths):
    """All runs by scene, method and budget: (errors, time, samples per pixel) by seed.

    Studies whose folders are in one folder are one race. Times are over that of uniform sampling with the largest budget, in the
    same race and scene, so that methods may be raced later than others. Of several races of a method, the first with the most
    seeds counts.
    """
    races = {}
    for path in paths:
        folder = os.path.dirname(os.path.dirname(os.path.abspath(path)))
        races.setdefault(folder, []).extend(json.loads(line) for line in open(path))
    runs = {}
    for race in races.values():
        found = {}
        for run in race:
            method = "/".join(run["method"][part] for part in ("sampler", "points", "filter"))
            key = run["scene"], method, run["budget"]["spp"]
            found.setdefault(key, {})[run["seed"]] = (run["errors"], run["cpu_s"], run["spp"])
        many = max(spp for _, _, spp in found)
        for key, seeds in found.items():
            unit = median([cpu for _, cpu, _ in found[key[0], BASE, many].values()])
            if len(seeds) > len(runs.get(key, ())):
                runs[key] = {seed: (errors, cpu / unit, spp) for seed, (errors, cpu, spp) in seeds.items()}
    return runs


def mean(values):
    return sum(values) / len(values)


def median(values):
    values = sorted(values)
    return 0.5 * (values[(len(values) - 1) // 2] + values[len(values) // 2])


class Race:
    def __init__(self, runs):
        self.runs = runs
        self.scenes = list(dict.fromkeys(scene for scene, _, _ in runs))
        self.methods = list(dict.fromkeys(method for _, method, _ in runs))
        self.few, self.many = min(b for _, _, b in runs), max(b for _, _, b in runs)
        self.seeds = max(len(seeds) for seeds in runs.values())
        self.seconds = {key: median([cpu for _, cpu, _ in seeds.values()]) for key, seeds in runs.items()}
        self.taken = {key: mean([spp for _, _, spp in seeds.values()]) for key, seeds in runs.items()}

    def has(self, scene, method):
        return all(len(self.runs.get((scene, method, spp), ())) == self.seeds for spp in (self.few, self.many))

    def error(self, scene, method, spp, metric, seeds):
        of = self.runs[scene, method, spp]
        return max(mean([of[seed][0][metric] for seed in seeds]), 1e-12)

    def samples_in_time(self, scene, method):
        """The samples per pixel that the method takes in the time of its base, or None."""
        limit = self.seconds[scene, base_of(method), self.many]
        of = [(self.taken[scene, method, spp], self.seconds[scene, method, spp]) for spp in (self.few, self.many)]
        (n0, t0), (n1, t1) = of
        each = (t1 - t0) / max(n1 - n0, 1e-9)
        if each <= 0.0:
            return None
        samples = n0 + (limit - t0) / each
        return samples if samples >= 1.0 else None

    def error_in_time(self, scene, method, metric, seeds):
        samples = self.samples_in_time(scene, method)
        if samples is None:
            return None
        errors = [math.log(self.error(scene, method, spp, metric, seeds)) for spp in (self.few, self.many)]
        counts = [math.log(self.taken[scene, method, spp]) for spp in (self.few, self.many)]
        slope = (errors[1] - errors[0]) / max(counts[1] - counts[0], 1e-9)
        return math.exp(errors[1] + slope * (math.log(samples) - counts[1]))

    def ratio(self, scenes, method, base, what, metric, seeds):
        logs = []
        for scene in scenes:
            if what == "time":
                pair = [self.error_in_time(scene, method, metric, seeds), self.error(scene, base, self.many, metric, seeds)]
            else:
                pair = [self.error(scene, m, what, metric, seeds) for m in (method, base)]
            logs.append(math.log(pair[0] / pair[1]))
        return math.exp(mean(logs))


BESIDE = {"none": "unfiltered", "cluster-regression": "with the default filter"}


def kind_of(method):
    """The part of a method that is not uniform sampling's, and the other two parts: (kind, description, rest)."""
    sampler, points, filter = method.split("/")
    if sampler != "uniform":
        return "sampler", sampler if points == "sobol" else f"{sampler} with points {points}", filter
    if points != "sobol":
        return "points", points, filter
    return "filter", filter, "none"


def base_of(method):
    """Uniform Sobol' sampling with the same filter; without one for filters and point sets."""
    kind, _, filter = kind_of(method)
    return f"uniform/sobol/{filter}" if kind == "sampler" else BASE


class Row:
    """A method over its base in a group of scenes: a ratio of sRGB MSE with its interval, and of FLIP, per budget."""

    def __init__(self, race, method, group, seeds, draws):
        self.method, self.base, self.scenes = method, base_of(method), len(group)
        self.figures = {}
        for what in (race.few, race.many, "time"):
            fits = [s for s in group if what != "time" or race.samples_in_time(s, method)]
            if not fits:
                self.figures[what] = (None, None, None, None)
                continue
            drawn = sorted(race.ratio(fits, method, self.base, what, "srgb8_mse", chosen) for chosen in draws)
            self.figures[what] = (
                race.ratio(fits, method, self.base, what, "srgb8_mse", seeds),
                drawn[int(0.025 * len(drawn))],
                drawn[int(0.975 * len(drawn))],
                race.ratio(fits, method, self.base, what, "flip", seeds),
            )
        over = [race.seconds[scene, method, race.many] / race.seconds[scene, BASE, race.many] for scene in group]
        self.time = math.exp(mean([math.log(v) for v in over]))
        self.too_slow = sum(race.samples_in_time(scene, method) is None for scene in group)

    @classmethod
    def of_line(cls, line, budgets):
        """A row of a table that was written before."""
        row = cls.__new__(cls)
        _, row.method, row.base, scenes, *figures, time, too_slow = line
        row.scenes, row.time, row.too_slow = int(scenes), float(time), int(too_slow)
        numbers = [float(v) if v else None for v in figures]
        row.figures = {what: tuple(numbers[4 * i : 4 * i + 4]) for i, what in enumerate(budgets)}
        return row

    def line(self, label):
        figures = [f"{v:.4f}" if v is not None else "" for of in self.figures.values() for v in of]
        return [label, self.method, self.base, str(self.scenes), *figures, f"{self.time:.3f}", str(self.too_slow)]

    def verdict(self):
        value, low, high, _ = self.figures["time"]
        if value is None:
            return f"cannot finish 1 spp in that time on {self.too_slow} of {self.scenes} scenes"
        slow = f" over {self.scenes - self.too_slow} of {self.scenes} scenes (the others exceed that time with 1 spp)" if self.too_slow > 0 else ""
        return f"{value:.3g} [{low:.3g}, {high:.3g}]{slow}"

    def text(self, what):
        value, low, high, _ = self.figures[what]
        if value is None:
            return "too slow"
        few = f" ({self.scenes - self.too_slow} of {self.scenes})" if what == "time" and self.too_slow else ""
        return f"{value:.3g} [{low:.3g}, {high:.3g}]{few}"


def verdicts(rows, path, new):
    """One line per method: its error relative to uniform sampling at equal time. Lines that no new row concerns stay as they are."""
    concerned = {kind_of(method)[:2] for method in new}
    with open(path) as file:
        kept = {tuple(line.split("\t")[:2]): line for line in file}
    texts = {}
    for row in rows.values():
        kind, description, filter = kind_of(row.method)
        if row.method == BASE or (kind == "sampler" and filter not in BESIDE and row.base not in rows):
            continue
        beside = BESIDE.get(filter, f"with {filter}") + " " if kind == "sampler" else ""
        texts.setdefault((kind, description), []).append(f"{beside}{row.verdict()}")
    with open(path, "w") as out:
        for (kind, description), parts in texts.items():
            base = {"sampler": "uniform sampling with the same filter", "points": "sobol", "filter": "the unfiltered image"}[kind]
            line = f"{kind}\t{description}\tsRGB MSE relative to {base} at equal time (below 1 is better, [95 % interval]): {'; '.join(parts)}\n"
            out.write(line if (kind, description) in concerned else kept.get((kind, description), line))


def cell(row, what):
    """A ratio with its interval; bold where it is a win."""
    if row is None:
        return ""
    text = row.text(what)
    value, _, high, _ = row.figures[what]
    is_win = value is not None and high < 1.0 and not (what == "time" and row.too_slow)
    return f"**{text}**" if is_win else text


def sampler_table(rows, many):
    print(f"\n| sampler | alone, {many} spp | default filter, {many} spp | alone, equal time | default filter, equal time | own filter, equal time |")
    print("|---|---|---|---|---|---|")
    names = dict.fromkeys(kind_of(m)[1] for m in rows if kind_of(m)[0] == "sampler")
    lines = []
    for name in names:
        of = {kind_of(m)[2]: row for m, row in rows.items() if kind_of(m)[:2] == ("sampler", name)}
        alone, default = of.get("none"), of.get("cluster-regression")
        own = next(((f, row) for f, row in of.items() if f not in BESIDE), None)
        own = f"{cell(own[1], 'time')} (`{own[0]}`)" if own else ""
        first = alone.figures["time"][0] if alone and alone.figures["time"][0] else math.inf
        lines.append((first, f"| `{name}` | {cell(alone, many)} | {cell(default, many)} | {cell(alone, 'time')} | {cell(default, 'time')} | {own} |"))
    for _, line in sorted(lines):
        print(line)


def table_of(rows, kind, few, many):
    print(f"\n| {kind} | {few} spp | {many} spp | equal time | FLIP, equal time | time at {many} spp |\n|---|---|---|---|---|---|")
    chosen = [row for row in rows.values() if kind_of(row.method)[0] == kind and row.method != BASE]
    for row in sorted(chosen, key=lambda r: r.figures["time"][0] or r.figures[many][0] + 1e3):
        flip = row.figures["time"][3]
        flip = f"{flip:.3g}" if flip is not None else ""
        print(f"| `{kind_of(row.method)[1]}` | {cell(row, few)} | {cell(row, many)} | {cell(row, 'time')} | {flip} | {row.time:.2f} |")


def check(race):
    """Refuses runs from which a row would be missing without a word."""
    for method in dict.fromkeys([BASE, *race.methods]):
        base = base_of(method)
        if base not in race.methods:
            sys.exit(f"{method} is compared with {base}, of which there are no runs; race it too (methods.toml)")
        for scene in race.scenes:
            if race.has(scene, method) and not race.has(scene, base):
                sys.exit(f"{method} is compared with {base}, which lacks runs on {scene}; let its study run to the end")
            if not race.has(scene, method):
                print(f"{method}: not all of {race.seeds} seeds and both budgets on {scene}, which is left out", file=sys.stderr)


def head_of(race):
    head = ["scene", "method", "over", "scenes"]
    for what in (f"{race.few} spp", f"{race.many} spp", "equal time"):
        head += [f"srgb_mse, {what}", "low", "high", f"flip, {what}"]
    return head + [f"time over uniform, {race.many} spp", "scenes without a figure at equal time"]


def raced(race, method, seeds, draws):
    """The rows of a method: one per scene, then one per group of scenes."""
    known = [scene for scene in race.scenes if race.has(scene, method)]
    if not known:
        sys.exit(f"{method}: no scene has all of its runs; let its study run to the end")
    groups = {"all": known, "tuned": [s for s in known if s in TUNED], "held out": [s for s in known if s not in TUNED]}
    groups = {scene: [scene] for scene in known} | {label: group for label, group in groups.items() if group}
    return {label: Row(race, method, group, seeds, draws) for label, group in groups.items()}


def committed(path, race):
    """The rows of a table that was written before, by method and label. It must be of the same race."""
    with open(path, newline="") as file:
        head, *lines = csv.reader(file)
    if head != head_of(race):
        sys.exit(f"{path}: its budgets are not those of the runs; race with the scenes, budgets and seeds of methods.toml")
    budgets = (race.few, race.many, "time")
    table = {}
    for line in lines:
        table.setdefault(line[1], {})[line[0]] = Row.of_line(line, budgets)
    scenes = [label for label in table[BASE] if label not in ("all", "tuned", "held out")]
    if sorted(scenes) != sorted(race.scenes):
        sys.exit(f"{path}: its scenes are {', '.join(scenes)}; the runs have {', '.join(race.scenes)}")
    return table


def beside_committed(method, before, now, many):
    """Reports how a baseline that was raced again compares with the table."""
    old, new = before["all"], now["all"]
    print(f"{method}, raced again: {new.text(many)} at {many} spp, {new.time:.2f} of the time; the table has {old.text(many)}, {old.time:.2f}", file=sys.stderr)
    value, low, high, _ = old.figures[many]
    if not 0.98 * low <= new.figures[many][0] <= 1.02 * high:
        sys.exit(f"{method}: its error at {many} spp is not that of the table; the renderer has changed too much, so race all methods again")


def main(add, tables, verdict_file, paths):
    race = Race(read(paths))
    check(race)
    seeds = sorted(max(race.runs.values(), key=len))
    chance = random.Random(1)
    draws = [[chance.choice(seeds) for _ in seeds] for _ in range(200)]
    path = f"{tables}/methods.csv"
    table = committed(path, race) if add else {}
    new = [method for method in race.methods if method not in table]
    for method in race.methods:
        of = raced(race, method, seeds, draws)
        if method in table:
            beside_committed(method, table[method], of, race.many)
        else:
            table[method] = of
    with open(f"{path}.new", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(head_of(race))
        for of in table.values():
            out.writerows(row.line(label) for label, row in of.items())
    os.replace(f"{path}.new", path)
    rows = {method: of["all"] for method, of in table.items()}
    verdicts(rows, verdict_file, new)
    sampler_table(rows, race.many)
    for kind in ("filter", "points"):
        table_of(rows, kind, race.few, race.many)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    add = arguments[:1] == ["--add"]
    main(add, *arguments[add : add + 2], arguments[add + 2 :])
