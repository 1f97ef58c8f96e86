#!/usr/bin/env python3
"""default_image.py RUNS.JSONL...: a table of docs/results/default-image.md as CSV, from the runs of its studies.

Runs at equal time are labelled "time of N": the time that N spp of the baseline take. One row per scene, number of samples and method, then geometric means over scenes, named "all", "tuned" and "held out". Ratios are of means over
seeds; columns over OIDN are empty if it has no runs. Their 95 % intervals come from 2,000 resamplings of the seeds, the same seeds for both methods and all scenes.
"""
import csv
import json
import math
import random
import sys

# Scenes that settings were chosen on, or that were looked at meanwhile.
TUNED = ["cornell", "room", "glass", "lens", "grass", "cabin", "killeroo", "door", "tea"]
# The baselines.
UNIFORM, OIDN = "uniform + none", "uniform + oidn"


def name(method):
    return f"{method['sampler']} + {method['filter']}"


def budget(run):
    return str(run["budget"]["spp"]) if "spp" in run["budget"] else f"time of {run['budget']['time_of']}"


def read(paths):
    runs = {}
    for line in (line for path in paths for line in open(path)):
        run = json.loads(line)
        key = run["scene"], budget(run), name(run["method"])
        runs.setdefault(key, {})[run["seed"]] = run["errors"]
    return runs


def mean(values):
    return sum(values) / len(values)


def interval(draws):
    draws = sorted(draws)
    return draws[int(0.025 * len(draws))], draws[int(0.975 * len(draws))]


def main(paths):
    runs = read(paths)
    scenes = list(dict.fromkeys(scene for scene, _, _ in runs))
    budgets = sorted({spp for _, spp, _ in runs}, key=lambda text: (len(text), text))
    methods = list(dict.fromkeys(method for _, _, method in runs))
    seeds = sorted(next(iter(runs.values())))
    chance = random.Random(1)
    samples = [[chance.choice(seeds) for _ in seeds] for _ in range(2000)]
    groups = {"all": scenes, "tuned": [s for s in scenes if s in TUNED], "held out": [s for s in scenes if s not in TUNED]}

    def ratio(group, spp, method, base, metric, chosen):
        def one(scene):
            of = [mean([runs[scene, spp, m][seed][metric] for seed in chosen]) for m in (method, base)]
            return math.log(max(of[0], 1e-12) / max(of[1], 1e-12))

        return math.exp(mean([one(scene) for scene in group]))

    out = csv.writer(sys.stdout, lineterminator="\n")
    head = ["scene", "spp", "method"]
    for what in ("srgb_mse_over_uniform", "srgb_mse_over_oidn_on_uniform"):
        head += [what, "low", "high"]
    out.writerow(head + ["flip_over_oidn_on_uniform", "image_mean_over_reference", "standard_error_of_mean"])
    for label, group in [(scene, [scene]) for scene in scenes] + list(groups.items()):
        for spp in budgets:
            for method in methods:
                row = [label, spp, method]
                for base in (UNIFORM, OIDN):
                    if base not in methods:
                        row += [""] * 3
                        continue
                    draws = [ratio(group, spp, method, base, "srgb8_mse", chosen) for chosen in samples[: 2000 if len(group) == 1 else 300]]
                    row += [f"{v:.4f}" for v in (ratio(group, spp, method, base, "srgb8_mse", seeds), *interval(draws))]
                row.append(f"{ratio(group, spp, method, OIDN, 'flip', seeds):.4f}" if OIDN in methods else "")
                if len(group) == 1:
                    of = [runs[label, spp, method][seed]["mean_ratio"] for seed in seeds]
                    error = math.sqrt(sum((v - mean(of)) ** 2 for v in of) / (len(of) - 1) / len(of))
                    row += [f"{mean(of):.4f}", f"{error:.4f}"]
                out.writerow(row)


if __name__ == "__main__":
    main(sys.argv[1:])
