#!/usr/bin/env python3
"""transport.py RUNS.JSONL [CSV]: integrators beside path tracing, from the runs of docs/results/transport.toml.

Prints the tables of docs/results/transport.md and where each integrator wins; writes all figures to CSV.

Each row of CSV is a scene, integrator and method: relMSE over path's at equal samples, relMSE times seconds of tracing over path's (that is the ratio of
errors at equal time, if errors fall as 1/n), and the image's mean over the reference's. Tables have relMSE times seconds. Ratios are of means over seeds;
their 95 % intervals come from 2,000 resamplings of the seeds.
"""
import csv
import json
import random
import sys


def main(path, to=None):
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

    rows = []
    for key in runs:
        base = (*key[:2], "path")

        def error(chosen):
            return mean(key, 0, chosen) / mean(base, 0, chosen)

        cost = mean(key, 1, seeds) / mean(base, 1, seeds)
        draws = sorted(error(chosen) for chosen in samples)
        values = [error(seeds), draws[50], draws[1949]]
        rows.append((key, values, [v * cost for v in values], cost, mean(key, 2, seeds)))
    if to:
        with open(to, "w") as file:
            out = csv.writer(file, lineterminator="\n")
            out.writerow("scene method integrator error low high error_times_seconds low high seconds mean".split())
            for key, errors, times, cost, ratio in rows:
                figures = [f"{v:.3g}" for v in errors + times]
                out.writerow([*key, *figures, f"{cost:.2f}", f"{ratio:.3f}"])
    tables(rows)


def told(value, low, high):
    """A ratio with its interval, bold if it is below 1 as a whole; without interval if that is narrow."""
    text = f"{value:.2g}" if f"{low:.2g}" == f"{high:.2g}" else f"{value:.2g} [{low:.2g}, {high:.2g}]"
    return f"**{text}**" if high < 1 else text


def tables(rows):
    found = {key: times for key, _, times, _, _ in rows}
    integrators = list(dict.fromkeys(key[2] for key in found if key[2] != "path"))
    for method in dict.fromkeys(key[1] for key in found):
        print(f"\n{method}\n\n| scene | " + " | ".join(f"`{i}`" for i in integrators) + " |")
        print("|---" * (len(integrators) + 1) + "|")
        for scene in dict.fromkeys(key[0] for key in found):
            cells = [found.get((scene, method, i)) for i in integrators]
            print(f"| {scene} | " + " | ".join(told(*cell) if cell else "refused" for cell in cells) + " |")
    print()
    for integrator in integrators:
        wins = [f"{scene} ({method})" for (scene, method, i), times in found.items() if i == integrator and times[2] < 1]
        print(f"{integrator} wins " + (", ".join(wins) or "nowhere"))

if __name__ == "__main__":
    main(*sys.argv[1:])
