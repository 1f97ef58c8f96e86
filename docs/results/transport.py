#!/usr/bin/env python3
"""transport.py RUNS.JSONL: integrators beside path tracing, from the runs of docs/results/transport.toml, as CSV.

One row per scene, integrator and method: relMSE over path's at equal samples, relMSE times seconds of tracing over path's (that is the ratio of errors at
equal time, if errors fall as 1/n), and the image's mean over the reference's. Ratios are of means over seeds; their 95 % intervals come from 2,000
resamplings of the seeds.
"""
import csv
import json
import random
import sys


def main(path):
    runs = {}
    for line in open(path):
        run = json.loads(line)
        scene, integrator = run["scene"].rsplit("-", 1)
        seconds = run["seconds"]
        cost = seconds["trace"] + seconds["plan"] + seconds["filter"]
        key = scene, run["method"]["sampler"] + " + " + run["method"]["filter"], integrator
        runs.setdefault(key, {})[run["seed"]] = run["errors"]["relmse"], cost, run["errors"]["mean_ratio"]
    seeds = sorted(next(iter(runs.values())))
    chance = random.Random(1)
    samples = [[chance.choice(seeds) for _ in seeds] for _ in range(2000)]

    def mean(key, at, chosen):
        return sum(runs[key][seed][at] for seed in chosen) / len(chosen)

    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow("scene method integrator error low high error_times_seconds low high seconds mean".split())
    for key in runs:
        base = (*key[:2], "path")

        def error(chosen):
            return mean(key, 0, chosen) / mean(base, 0, chosen)

        cost = mean(key, 1, seeds) / mean(base, 1, seeds)
        draws = sorted(error(chosen) for chosen in samples)
        values = [error(seeds), draws[50], draws[1949]]
        row = [f"{v:.3g}" for v in values] + [f"{v * cost:.3g}" for v in values]
        out.writerow([*key, *row, f"{cost:.2f}", f"{mean(key, 2, seeds):.3f}"])


main(*sys.argv[1:])
