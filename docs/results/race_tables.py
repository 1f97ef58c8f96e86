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

    def ratio(self, scenes, method, spp, value):
        """The ratio for each seed, as the geometric mean over scenes, and the largest of a scene; None if runs are missing or an
        error is not above 0: the reference is too noisy."""
        logs, worst = {}, 0.0
        for scene in scenes:
            a, b = (self.runs.get((scene, m, spp), {}) for m in (method, BASE))
            seeds = a.keys() & b.keys()
            ratios = {seed: value(a[seed]) / value(b[seed]) for seed in seeds if value(b[seed]) > 0}
            if not ratios or min(ratios.values()) <= 0:
                return None
            worst = max(worst, math.exp(mean(map(math.log, ratios.values()))))
            for seed, ratio in ratios.items():
                logs.setdefault(seed, []).append(math.log(ratio))
        means = [math.exp(mean(of)) for of in logs.values() if len(of) == len(scenes)]
        return (means, worst) if means else None

    def row(self, scenes, method, value):
        cells = [self.ratio(scenes, method, spp, value) for spp in self.spp]
        return [f"{interval(c[0])}, {c[1]:.2f}" if c else "–" for c in cells]

    def print(self, title):
        held = [scene for scene in self.scenes if scene not in TUNED]
        heads = [f"{spp} spp" for spp in self.spp]
        for name, scenes in (("held-out scenes", held), ("scenes that settings were chosen on", [s for s in self.scenes if s in TUNED])):
            for metric, label in METRICS.items():
                rows = [[m, *self.row(scenes, m, lambda run: run["errors"][metric])] for m in self.methods if m != BASE]
                if scenes:
                    table(f"{title}: {label}, {len(scenes)} {name}", ["method", *heads], rows)
        cells = lambda scene: [self.ratio([scene], DEFAULT, spp, lambda run: run["errors"]["srgb8_mse4"]) for spp in self.spp]
        rows = [[scene, *(interval(c[0]) if c else "–" for c in cells(scene))] for scene in self.scenes]
        table(f"{title}: the default by scene, sRGB MSE of means of 4x4 pixels", ["scene", *heads], rows)
        rows = [[m, *self.row(self.scenes, m, lambda run: run["render_s"])] for m in self.methods if m != BASE]
        table(f"{title}: seconds, all scenes", ["method", *heads], rows)
        light = lambda method, scene, spp: [run["errors"]["mean_ratio"] for run in self.runs.get((scene, method, spp), {}).values()]
        ends = lambda means: f"{min(means)[0]:.3f} ({min(means)[1]}), {max(means)[0]:.3f} ({max(means)[1]})" if means else "–"
        rows = [[m, *(ends([(mean(light(m, s, spp)), s) for s in self.scenes if light(m, s, spp)]) for spp in self.spp)] for m in (DEFAULT, BASE)]
        table(f"{title}: mean of the image over that of the reference, mean over seeds, the least and the largest of all scenes", ["method", *heads], rows)


folders = {}
for file in sorted(Path(sys.argv[1]).glob("*/study.json")):
    resolution = json.loads(file.read_text(encoding="utf-8"))["scenes"][0]["resolution"]
    folders.setdefault("x".join(map(str, resolution)), []).append(file.parent)
for resolution, all in folders.items():
    Race(all).print(resolution)
