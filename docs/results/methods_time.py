#!/usr/bin/env python3
"""methods_time.py RUNS.JSONL... > TABLE.csv: errors at a time that was measured, from the runs of docs/results/methods-time.toml.

All methods, filtered or not, take the wall seconds of unfiltered uniform sampling with the plan's time_of samples per pixel. One row per
method and group of scenes: its sRGB MSE over that of uniform Sobol' sampling with the same filter, and over that without a filter, with
95 % intervals over seeds; the seconds over the baseline's; the scenes. A scene where the method, with its fewest samples, takes over 1.1 of the
time is left out of the means. Runs that come twice count as in the last file. On stderr, the means over all scenes as a Markdown table.
"""
import csv
import json
import math
import random
import sys

from methods import BASE, TUNED, mean, median


def main(paths):
    runs = {}
    for run in (json.loads(line) for path in paths for line in open(path)):
        if "time_of" in run["budget"]:
            method = "/".join(run["method"][part] for part in ("sampler", "points", "filter"))
            runs.setdefault((run["scene"], method), {})[run["seed"]] = run["errors"]["srgb8_mse"], run["render_s"]
    if not runs:
        sys.exit("no run with a measured time; give runs.jsonl of methods-time.toml")
    scenes, methods = (list(dict.fromkeys(key[part] for key in runs)) for part in (0, 1))
    seeds = sorted(runs[scenes[0], BASE])
    short = [key for key in runs if sorted(runs[key]) != seeds]
    if short or len(runs) != len(scenes) * len(methods):
        sys.exit(f"runs are missing, such as of {(short or ['a scene'])[0]}; let the studies run to the end")
    chance = random.Random(1)
    draws = [[chance.choice(seeds) for _ in seeds] for _ in range(1000)]

    def ratio(group, method, base, chosen):
        error = lambda scene, of: mean([runs[scene, of][seed][0] for seed in chosen])
        return math.exp(mean([math.log(error(scene, method) / error(scene, base)) for scene in group]))

    def interval(group, method, base):
        drawn = sorted(ratio(group, method, base, chosen) for chosen in draws)
        return ratio(group, method, base, seeds), drawn[25], drawn[974]

    groups = {"all": scenes, "tuned": [s for s in scenes if s in TUNED], "held out": [s for s in scenes if s not in TUNED]}
    seconds = lambda scene, of: median([of_seed[1] for of_seed in runs[scene, of].values()])
    groups = {scene: [scene] for scene in scenes} | groups
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["scenes", "method", "over the same filter", "low", "high", "over no filter", "low", "high", "seconds", "count"])
    print(f"| method | over uniform, same filter | over uniform, no filter | its time | scenes |\n|---|---|---|---|---|", file=sys.stderr)
    for method in methods:
        same = f"uniform/sobol/{method.split('/')[2]}"
        for label, group in groups.items():
            if len(group) > 1:
                group = [s for s in group if seconds(s, method) <= 1.1 * seconds(s, BASE)]
            took = math.exp(mean([math.log(seconds(s, method) / seconds(s, BASE)) for s in group]))
            values = [*interval(group, method, same), *interval(group, method, BASE)]
            out.writerow([label, method, *(f"{v:.4f}" for v in values), f"{took:.3f}", len(group)])
            if label == "all" and method != BASE:
                cells = ["{:.3g} [{:.3g}, {:.3g}]".format(*values[at : at + 3]) for at in (0, 3)]
                cells = [f"**{text}**" if values[at + 2] < 1.0 else text for text, at in zip(cells, (0, 3))]
                print(f"| `{method}` | {cells[0] if same != method else ''} | {cells[1]} | {took:.2f} | {len(group)} |", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
