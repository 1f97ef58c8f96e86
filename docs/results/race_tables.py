#!/usr/bin/env python3
"""race_tables.py FOLDER: the tables of race.md as Markdown, from the studies in the folders within FOLDER; one set for each resolution.

Each ratio is a method's error over that of Open Image Denoise on uniform samples: the geometric mean over scenes, its 95 % interval over
seeds (Student's t of logarithms), and the worst scene.
"""
import json
import math
import sys
from pathlib import Path

from study_tables import interval

METRICS = {"srgb8_mse4": "sRGB MSE of means of 4x4 pixels", "srgb8_mse": "sRGB MSE", "flip": "FLIP"}
BASE, DEFAULT = "uniform + oidn", "adaptive + cluster-regression"
ERROR, SECONDS = lambda run: run["errors"]["srgb8_mse4"], lambda run: run["render_s"]
TUNED = "cornell room glass lens grass teapot terrain cabin cornell-box teapot-v4 killeroo".split()


def mean(values):
    values = list(values)
    return sum(values) / len(values)


def table(title, heads, rows):
    print(f"\n**{title}**\n\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")


class Race:
    """Runs by scene, method and samples per pixel, then by seed."""

    def __init__(self, folders):
        self.runs = {}
        texts = [(folder / "runs.jsonl").read_text(encoding="utf-8") for folder in folders]
        for run in (json.loads(line) for text in texts for line in text.splitlines()):
            method = run["method"]["sampler"] + ("" if run["method"]["filter"] == "none" else f" + {run['method']['filter']}")
            self.runs.setdefault((run["scene"], method, run["budget"]["spp"]), {})[run["seed"]] = run
        self.scenes, self.methods, self.spp = (list(dict.fromkeys(key[i] for key in self.runs)) for i in range(3))
        self.spp.sort()

    def values(self, method, spp, value):
        """A function of the scene: the value of each seed's run."""
        return lambda scene: {seed: value(run) for seed, run in self.runs.get((scene, method, spp), {}).items()}

    def in_time_of(self, spp):
        """A function of the scene: the default's error in the seconds of that many uniform samples, interpolated between its runs."""

        def errors(scene):
            found = {}
            for seed, run in self.runs.get((scene, "uniform", spp), {}).items():
                runs = [self.runs.get((scene, DEFAULT, n), {}).get(seed) for n in self.spp]
                curve = [(r["render_s"], ERROR(r)) for r in runs if r]
                pairs = list(zip(curve, curve[1:]))
                if pairs and min(e for _, e in curve) > 0:
                    (t0, e0), (t1, e1) = next((pair for pair in pairs if run["render_s"] <= pair[1][0]), pairs[-1])
                    found[seed] = e0 * (e1 / e0) ** (math.log(run["render_s"] / t0) / math.log(t1 / t0))
            return found

        return errors

    def ratio(self, scenes, above, below):
        """The ratio for each seed, as the geometric mean over scenes, and the largest of a scene; None if runs are missing or an
        error is not above 0: the reference is too noisy."""
        logs, worst = {}, 0.0
        for scene in scenes:
            a, b = above(scene), below(scene)
            ratios = {seed: a[seed] / b[seed] for seed in a.keys() & b.keys() if b[seed] > 0}
            if not ratios or min(ratios.values()) <= 0:
                return None
            worst = max(worst, math.exp(mean(map(math.log, ratios.values()))))
            for seed, ratio in ratios.items():
                logs.setdefault(seed, []).append(math.log(ratio))
        means = [math.exp(mean(of)) for of in logs.values() if len(of) == len(scenes)]
        return (means, worst) if means else None

    def row(self, scenes, method, value):
        cells = [self.ratio(scenes, self.values(method, spp, value), self.values(BASE, spp, value)) for spp in self.spp]
        return [f"{interval(c[0])}, {c[1]:.2f}" if c else "–" for c in cells]

    def others(self, scenes):
        """The default at other samples than OIDN, and in the time of uniform samples with OIDN's own time left out."""
        cases = [(f"the default at {a} spp, OIDN at {b}", [self.values(DEFAULT, a, v) for v in (ERROR, SECONDS)], b) for a, b in ((2, 1), (16, 8))]
        cases += [(f"the default in the time of {b} uniform samples", [self.in_time_of(b)], b) for b in (8, 16)]
        for name, above, b in cases:
            found = [self.ratio(scenes, of, self.values(BASE, b, v)) for of, v in zip(above, (ERROR, SECONDS))]
            yield [name, *(interval(c[0]) if c else "–" for c in found), *["–"] * (2 - len(found))]

    def print(self):
        held = [scene for scene in self.scenes if scene not in TUNED]
        heads = [f"{spp} spp" for spp in self.spp]
        for name, scenes in (("held-out scenes", held), ("scenes that settings were chosen on", [s for s in self.scenes if s in TUNED])):
            for metric, label in METRICS.items():
                rows = [[m, *self.row(scenes, m, lambda run: run["errors"][metric])] for m in self.methods if m != BASE]
                if scenes:
                    table(f"{label}, {len(scenes)} {name}", ["method or scene", *heads], rows)
        cells = lambda scene: [self.ratio([scene], self.values(DEFAULT, spp, ERROR), self.values(BASE, spp, ERROR)) for spp in self.spp]
        rows = [[scene, *(interval(c[0]) if c else "–" for c in cells(scene))] for scene in self.scenes]
        table("the default by scene, sRGB MSE of means of 4x4 pixels", ["method or scene", *heads], rows)
        rows = [[m, *self.row(self.scenes, m, SECONDS)] for m in self.methods if m != BASE]
        table("seconds, all scenes", ["method or scene", *heads], rows)
        table("other comparisons over OIDN on uniform samples, all scenes", ["method or scene", "error", "seconds"], self.others(self.scenes))
        light = lambda method, scene, spp: [run["errors"]["mean_ratio"] for run in self.runs.get((scene, method, spp), {}).values()]
        ends = lambda means: f"{min(means)[0]:.3f} ({min(means)[1]}), {max(means)[0]:.3f} ({max(means)[1]})" if means else "–"
        rows = [[m, *(ends([(mean(light(m, s, spp)), s) for s in self.scenes if light(m, s, spp)]) for spp in self.spp)] for m in (DEFAULT, BASE)]
        table("mean of the image over that of the reference, mean over seeds, the least and the largest of all scenes", ["method or scene", *heads], rows)


def main():
    folders = {}
    for file in sorted(Path(sys.argv[1]).glob("*/study.json")):
        resolution = json.loads(file.read_text(encoding="utf-8"))["scenes"][0]["resolution"]
        folders.setdefault("x".join(map(str, resolution)), []).append(file.parent)
    for resolution, studies in folders.items():
        print(f"\n## {resolution}")
        Race(studies).print()


if __name__ == "__main__":
    main()
