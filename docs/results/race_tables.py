#!/usr/bin/env python3
"""race_tables.py [OPTION DIR]... DIR...: the tables of race.md as Markdown, from folders of finished studies with the same seeds.

* --long DIR: the baseline alone at larger budgets, for times to equal error; --besides DIR: other methods on the same scenes;
* --lights DIR: the scenes room, room-uniform and room-learned;
* --foreign DIR: the same methods against references of another renderer, and the baseline at a very large budget;
* --tuned NAME,...: scenes that settings were tuned on; --plain NAME,...: scenes without interreflection.
"""
import json
import math
import sys
from pathlib import Path

from study_tables import T95

METRICS = {"sRGB MSE": "srgb8_mse", "relMSE": "relmse", "FLIP": "flip"}
UNIFORM, DEFAULT, THESIS = "uniform", "adaptive:epsilon=0.3 + cluster-regression", "cluster-thesis + cluster-gaussian"
COUNTS, OIDN, OIDN_ON_OURS, PREFILTERED = "adaptive:epsilon=0.01", "uniform + oidn", "adaptive:epsilon=0.3 + oidn", "uniform + oidn-prefiltered"
# The largest factor beyond the longest measured time to which a curve is followed, along its last piece; and that for the long
# curve of uniform sampling.
REACH, LONG_REACH = 1.5, 4.0


def median(values):
    values = sorted(values)
    return 0.5 * (values[(len(values) - 1) // 2] + values[len(values) // 2])


def mean(values):
    return sum(values) / len(values)


def name(method):
    return method["sampler"] + ("" if method["filter"] == "none" else f" + {method['filter']}")


def spent(run):
    """CPU seconds, which other work on the machine hardly changes; wall seconds if those are unknown."""
    return run["render_s"] if run.get("cpu_s") is None else run["cpu_s"]


def number(value):
    """Three significant digits."""
    return f"{value:.{min(max(2 - math.floor(math.log10(value)), 0), 4) if value > 0 else 2}f}"


def figure(values, mark=""):
    """`0.21 [0.20, 0.23]` and a mark: the geometric mean over seeds with its 95 % interval; None unless all values are above 0."""
    values = list(values)
    if not values or not all(0 < v < math.inf for v in values):
        return None
    logs = [math.log(v) for v in values]
    n, middle = len(logs), mean(logs)
    ends = ""
    if n > 1:
        half = (T95[n - 2] if n <= 31 else 1.96 + 2.4 / (n - 1)) * math.sqrt(sum((v - middle) ** 2 for v in logs) / (n - 1) / n)
        ends = f" [{number(math.exp(middle - half))}, {number(math.exp(middle + half))}]"
    return number(math.exp(middle)) + ends + mark


def table(title, heads, rows):
    print(f"\n**{title}**\n\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(cell or '–' for cell in row)} |")


class Board:
    """All runs by scene, method and samples per pixel, then by seed. Runs of `more` count where the studies have none."""

    def __init__(self, folders, more=()):
        self.cells, self.studies = {}, [json.loads((Path(f) / "study.json").read_text(encoding="utf-8")) for f in folders]
        self.scenes = list(dict.fromkeys(scene["name"] for study in self.studies for scene in study["scenes"]))
        self.methods = list(dict.fromkeys(name(m) for study in self.studies for m in study["methods"]))
        self.spp = sorted({n for study in self.studies for n in study["spp"]})
        for folder in [*folders, *more]:
            for run in map(json.loads, (Path(folder) / "runs.jsonl").read_text(encoding="utf-8").splitlines()):
                if "spp" in run["budget"]:
                    self.cells.setdefault((run["scene"], name(run["method"]), run["budget"]["spp"]), {}).setdefault(run["seed"], run)

    def runs(self):
        return [run for seeds in self.cells.values() for run in seeds.values()]

    def budgets(self, scene, method):
        return sorted((spp, seeds) for (s, m, spp), seeds in self.cells.items() if (s, m) == (scene, method))

    def seconds(self, scene, method, spp, of=spent):
        seeds = self.cells.get((scene, method, spp))
        return median([of(run) for run in seeds.values()]) if seeds else None

    def errors(self, scene, method, at, metric):
        """One error for each seed, and a mark. `at` is ("spp", N), or ("time", N): each seed's curve of error over the median
        times, interpolated on logarithmic axes at the time of uniform sampling with N."""
        error = lambda seeds: {seed: run["errors"].get(metric) or math.nan for seed, run in seeds.items()}
        if at[0] == "spp" or method == UNIFORM:
            seeds = self.cells.get((scene, method, at[1]))
            return (error(seeds), "") if seeds else None
        target, curve = self.seconds(scene, UNIFORM, at[1]), []
        for spp, seeds in self.budgets(scene, method):
            time = self.seconds(scene, method, spp)
            # More samples take longer: a median that does not rise is noise of a loaded machine.
            if spp in self.spp and (not curve or time > curve[-1][0]):
                curve.append((time, error(seeds)))
        if not curve or target is None:
            return None
        if target < curve[0][0]:
            return curve[0][1], f" ‡{curve[0][0] / target:.2f}"
        if len(curve) < 2:
            return None
        time = min(target, curve[-1][0] * REACH)
        above = max(next((i for i, (t, _) in enumerate(curve) if t >= time), len(curve) - 1), 1)
        (t0, a), (t1, b) = curve[above - 1], curve[above]
        share = math.log(time / t0) / math.log(t1 / t0)
        found = {s: math.exp(math.log(a[s]) + share * math.log(b[s] / a[s])) for s in a if s in b and a[s] > 0 and b[s] > 0}
        return found, "†" if target > curve[-1][0] * 1.02 else ""

    def ratios(self, a, b, at, metric):
        """Errors of `a` over those of `b`, seed by seed; each is a scene and a method."""
        x, y = self.errors(*a, at, metric), self.errors(*b, at, metric)
        if not x or not y:
            return None
        found = {seed: error / y[0][seed] for seed, error in x[0].items() if y[0].get(seed)}
        good = found and all(0 < v < math.inf for v in found.values())
        return (found, x[1] or y[1]) if good else None

    def ratio(self, a, b, at, metric):
        found = self.ratios(a, b, at, metric)
        return figure(found[0].values(), found[1]) if found else None

    def mean(self, scenes, a, b, at, metric):
        """The geometric mean over scenes; its interval is over the seeds' own means. None if a scene has no ratio, since leaving it
        out would flatter a method."""
        all_ = [self.ratios((s, a), (s, b), at, metric) for s in scenes]
        if not all_ or None in all_:
            return None
        seeds = [s for s in all_[0][0] if all(s in ratios for ratios, _ in all_)]
        slow = max((mark for _, mark in all_ if "‡" in mark), key=lambda mark: float(mark[2:]), default=None)
        mark = slow or next((mark for _, mark in all_ if mark), "")
        return figure([math.exp(mean([math.log(ratios[s]) for ratios, _ in all_])) for s in seeds], mark)

    def times_to_error(self, scene, method, spp, metric):
        """Times that uniform sampling takes to the error of a method with `spp`, over that method's time, and a mark."""
        own, errors, curve = self.seconds(scene, method, spp), self.errors(scene, method, ("spp", spp), metric), []
        for n, seeds in self.budgets(scene, UNIFORM):
            point = self.seconds(scene, UNIFORM, n), [run["errors"][metric] for run in seeds.values()]
            if min(point[1]) > 0 and (not curve or (point[0] > curve[-1][0] and mean([math.log(e) for e in point[1]]) < curve[-1][1])):
                curve.append((point[0], mean([math.log(e) for e in point[1]])))
        # Noise alone may keep an error from falling.
        if own is None or not errors or len(curve) < 2 or not all(e > 0 for e in errors[0].values()):
            return None
        times = []
        for error in errors[0].values():
            at = min(max(next((i for i, (_, e) in enumerate(curve) if e <= math.log(error)), len(curve)), 1), len(curve) - 1)
            (t0, e0), (t1, e1) = curve[at - 1], curve[at]
            times.append(math.exp(math.log(t0) + math.log(t1 / t0) * (e0 - math.log(error)) / (e0 - e1)))
        last = curve[-1][0]
        return [min(t, LONG_REACH * last) / own for t in times], "†" if max(times) > last else ""

    def above_floor(self, scene, method, spp, metric):
        """The ratio over uniform sampling's error against a noisy reference; the error of an image of very many samples is
        subtracted from both."""
        longest = self.budgets(scene, UNIFORM)[-1][0]
        floor, x, y = (self.errors(scene, m, ("spp", n), metric) for m, n in ((UNIFORM, longest), (method, spp), (UNIFORM, spp)))
        if not (x and y and floor):
            return None
        least = mean(list(floor[0].values()))
        pairs = [(error - least, y[0][seed] - least) for seed, error in x[0].items() if seed in y[0]]
        return figure([a / b for a, b in pairs]) if all(a > 0 and b > 0 for a, b in pairs) else None


def head(board):
    runs = board.runs()
    commits = list(dict.fromkeys(s["commit"] for s in board.studies if s["commit"]))
    loads = [run["load"] for run in runs if run.get("load") is not None]
    expected = sum(math.prod(len(study[part]) for part in ("scenes", "methods", "spp", "seeds")) for study in board.studies)
    print(
        f"Commit {', '.join(commits) or 'unknown'}; {len(board.scenes)} scenes, {len(board.methods)} methods on `sobol`, "
        f"{', '.join(map(str, board.spp))} spp, {len(board.studies[0]['seeds'])} seeds, {board.studies[0]['machine']['threads']} "
        f"thread a run; {len(runs)} runs, of {expected} and the long ones; mean load average {mean(loads or [0]):.2f}; {sum(r['reference_limited'] for r in runs)} runs "
        f"within 100 times the reference's own variance, which is taken out; {sum(r['rejected'] for r in runs)} samples rejected.\n\n"
        "Ratios are over `uniform` at the same place unless said otherwise, the geometric mean over seeds, paired; [ , ] are 95 % "
        "intervals over seeds. Over scenes: geometric means; their intervals are of the seeds, the scenes taken as they are. Equal "
        "time: each seed's curve of error over median CPU seconds (of OIDN what it says of itself), interpolated on logarithmic axes, at "
        "the median CPU seconds of `uniform`. †: followed beyond what was measured. ‡: the fewest samples that were tried took so many "
        "times as long; the error is that of those.\n"
    )
    described = {}
    for scene in (scene for study in board.studies for scene in study["scenes"]):
        spp, own = (scene["reference"][part] for part in ("spp", "relmse"))
        of = f"{spp} spp" if spp else "a file", "unknown" if own is None else f"{own:.1e}"
        described[scene["name"]] = f"{scene['name']} {'x'.join(map(str, scene['resolution']))} ({of[0]}, relMSE of the reference {of[1]})"
    print("; ".join(described.values()))


def besides(board):
    """Comparisons over all scenes."""
    pairs = [
        ("counts alone over uniform", COUNTS, UNIFORM),
        ("default over OIDN on the same counts", DEFAULT, OIDN_ON_OURS),
        ("OIDN on our counts over OIDN on uniform ones", OIDN_ON_OURS, OIDN),
        ("default over OIDN on uniform samples", DEFAULT, OIDN),
        ("default over OIDN with prefiltered features on uniform samples", DEFAULT, PREFILTERED),
        ("default over the thesis", DEFAULT, THESIS),
        ("default over uniform", DEFAULT, UNIFORM),
    ]
    places = [(kind, n) for n in board.spp for kind in ("spp", "time")]
    rows = [[f"{what}, {m}"] + [board.mean(board.scenes, a, b, at, METRICS[m]) for at in places] for what, a, b in pairs for m in METRICS]
    table("Besides, over all scenes", ["", *(f"{n} spp" if kind == "spp" else f"time of {n}" for kind, n in places)], rows)


def times(board, plain):
    methods = [COUNTS, DEFAULT, OIDN, OIDN_ON_OURS, PREFILTERED, THESIS]
    for m in ("sRGB MSE", "relMSE"):
        found = {s: [board.times_to_error(s, method, 32, METRICS[m]) for method in methods] for s in board.scenes}
        rows = [[s, *(of and figure(*of) for of in row)] for s, row in found.items()]
        columns = zip(*(row for s, row in found.items() if s not in plain))
        means = [figure([math.exp(mean([mean([math.log(t) for t in of[0]]) for of in c]))]) if None not in c else None for c in columns]
        rows.append(["geometric mean, scenes with interreflection", *means])
        table(f"Times as long that `uniform` takes to the {m} that each has with 32 spp", ["scene", *methods], rows)


def costs(board):
    spp = 32 if 32 in board.spp else board.spp[-1]
    pixels = {s["name"]: math.prod(s["resolution"]) for study in board.studies for s in study["scenes"]}
    cost = lambda s, m, of: None if (v := board.seconds(s, m, spp, of)) is None else number(v)
    heads = ["scene", *board.methods]
    rows = [[s, *(cost(s, m, spent) for m in board.methods)] for s in board.scenes]
    table(f"Seconds of an image with {spp} spp, all but reading and building the scene", heads, rows)
    rows = [[s, *(cost(s, m, lambda run: 1e6 * run["seconds"]["filter"] / pixels[s]) for m in board.methods)] for s in board.scenes]
    table(f"Microseconds a pixel of the filter alone, {spp} spp", heads, rows)
    share = lambda run: 100 * sum(run["seconds"][part] for part in ("plan", "cluster", "probe")) / run["render_s"]
    rows = [[s, cost(s, DEFAULT, share)] for s in board.scenes]
    table(f"Clusters, probes and planning of {DEFAULT}, % of the time, {spp} spp", ["scene", "%"], rows)


def lights(board):
    """Errors of the light selections. Their time is over that of uniform selection with uniform counts: each scene's own time would
    hide the cost of learning."""
    base, rows = ("room-uniform", UNIFORM), []
    for scene, method in ((s, m) for s in board.scenes for m in board.methods):
        for m in ("sRGB MSE", "relMSE"):
            row = [f"{scene}, {method}: {m}"]
            for n in board.spp:
                pair = board.seconds(scene, method, n), board.seconds(*base, n)
                row += [board.ratio((scene, method), base, ("spp", n), METRICS[m]), number(pair[0] / pair[1]) if all(pair) else None]
            rows.append(row)
    heads = ["", *(head for n in board.spp for head in (f"{n} spp", "seconds over"))]
    table("Choice among lights: over `room-uniform` with uniform counts and no filter", heads, rows)


def foreign(theirs, own):
    rows = []
    for scene, method, n in ((s, m, n) for s in theirs.scenes for m in theirs.methods if m != UNIFORM for n in theirs.spp if n <= 64):
        row = [f"{scene}, {method}, {n} spp"]
        for m in ("sRGB MSE", "relMSE"):
            row += [theirs.above_floor(scene, method, n, METRICS[m]), own.ratio((scene, method), (scene, UNIFORM), ("spp", n), METRICS[m])]
        rows.append(row)
    table(
        "Against references of pbrt-v4 (averaged down; what an image of the baseline with very many samples still differs by taken out) "
        "and, at the race's resolution, against our own",
        ["", "sRGB MSE, theirs", "ours", "relMSE, theirs", "ours"],
        rows,
    )


def every(board, tuned):
    """Every method on every scene."""
    methods = [m for m in board.methods if m != UNIFORM]
    groups = {"all": board.scenes, "tuned on": [s for s in board.scenes if s in tuned], "held out": [s for s in board.scenes if s not in tuned]}
    for kind, n, m in ((kind, n, m) for kind in ("spp", "time") for n in board.spp for m in METRICS):
        at, metric = (kind, n), METRICS[m]
        rows = [[s, *(board.ratio((s, method), (s, UNIFORM), at, metric) for method in methods)] for s in board.scenes]
        for title, scenes in groups.items():
            if scenes:
                rows.append([f"**geometric mean, {title}**", *(board.mean(scenes, method, UNIFORM, at, metric) for method in methods)])
        table(f"{m} at {n} spp" if kind == "spp" else f"{m} at the time of {n} spp", ["scene", *methods], rows)


def main(words):
    options = {"long": [], "besides": [], "lights": [], "foreign": [], "tuned": [], "plain": []}
    studies = []
    while words:
        word = words.pop(0)
        if not word.startswith("--"):
            studies.append(word)
        elif word[2:] in options and words:
            options[word[2:]] += words.pop(0).split(",") if word in ("--tuned", "--plain") else [words.pop(0)]
        else:
            sys.exit(f"{word} is no option, or lacks its value\n{__doc__}")
    if not studies:
        sys.exit(__doc__)
    board = Board(studies, options["long"] + options["besides"])
    for scene in options["tuned"] + options["plain"]:
        if scene not in board.scenes:
            sys.exit(f'unknown scene "{scene}"; the scenes are {", ".join(board.scenes)}')
    head(board)
    besides(board)
    times(board, options["plain"])
    costs(board)
    if options["lights"]:
        lights(Board(options["lights"]))
    if options["foreign"]:
        foreign(Board(options["foreign"]), board)
    every(board, options["tuned"])


if __name__ == "__main__":
    main(sys.argv[1:])
