#!/usr/bin/env python3
"""methods.py RUNS.JSONL... > methods.csv: the errors of every method over those of uniform sampling, from the runs of its studies.

At equal samples, errors are compared as they are. At equal time, a method gets the CPU seconds that uniform sampling without a
filter takes for 32 spp: its time is a line through its own two budgets, its error a power of the samples through the same two.
A method that these lines give less than 1 spp has no figure. One row per scene and method, then geometric means over scenes
("all"). Errors are means over seeds; 95 % intervals come from resamplings of the seeds, the same for all methods and scenes.
"""
import csv
import json
import math
import random
import sys

METRICS = ["srgb8_mse", "flip"]
BASE = "uniform/sobol/none"


def read(paths):
    runs = {}
    for line in (line for path in paths for line in open(path)):
        run = json.loads(line)
        method = "/".join(run["method"][part] for part in ("sampler", "points", "filter"))
        key = run["scene"], method, run["budget"]["spp"]
        runs.setdefault(key, {})[run["seed"]] = (run["errors"], run["cpu_s"], run["spp"])
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
        self.seconds = {key: median([cpu for _, cpu, _ in seeds.values()]) for key, seeds in runs.items()}
        self.taken = {key: mean([spp for _, _, spp in seeds.values()]) for key, seeds in runs.items()}

    def has(self, scene, method):
        return all((scene, method, spp) in self.runs for spp in (self.few, self.many))

    def error(self, scene, method, spp, metric, seeds):
        of = self.runs[scene, method, spp]
        return max(mean([of[seed][0][metric] for seed in seeds]), 1e-12)

    def samples_in_time(self, scene, method):
        """The samples per pixel that the method takes in the time of uniform sampling, or None."""
        limit = self.seconds[scene, BASE, self.many]
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
                pair = [self.error_in_time(scene, m, metric, seeds) for m in (method, base)]
                if None in pair:
                    return None
            else:
                pair = [self.error(scene, m, what, metric, seeds) for m in (method, base)]
            logs.append(math.log(pair[0] / pair[1]))
        return math.exp(mean(logs))


def bases(method, methods):
    """Uniform sampling without a filter, and with the method's filter where that is another."""
    beside = f"uniform/sobol/{method.split('/')[-1]}"
    return BASE, beside if beside in methods else None


def main(paths):
    race = Race(read(paths))
    seeds = sorted(next(iter(race.runs.values())))
    chance = random.Random(1)
    draws = [[chance.choice(seeds) for _ in seeds] for _ in range(400)]
    out = csv.writer(sys.stdout, lineterminator="\n")
    head = ["scene", "method", "over", "scenes"]
    for what in (f"{race.few} spp", f"{race.many} spp", "equal time"):
        head += [f"srgb_mse, {what}", "low", "high", f"flip, {what}"]
    out.writerow(head + [f"seconds, {race.few} spp", f"time over uniform, {race.many} spp", "samples in equal time"])
    for method in race.methods:
        known = [scene for scene in race.scenes if race.has(scene, method)]
        for label, group in [(scene, [scene]) for scene in known] + [("all", known)]:
            for base in dict.fromkeys(b for b in bases(method, race.methods) if b):
                row = [label, method, base, len(group)]
                for what in (race.few, race.many, "time"):
                    value = race.ratio(group, method, base, what, "srgb8_mse", seeds)
                    if value is None:
                        row += [""] * 4
                        continue
                    resampled = sorted(race.ratio(group, method, base, what, "srgb8_mse", chosen) for chosen in draws)
                    low, high = resampled[int(0.025 * len(draws))], resampled[int(0.975 * len(draws))]
                    flip = race.ratio(group, method, base, what, "flip", seeds)
                    row += [f"{v:.4f}" for v in (value, low, high, flip)]
                cost = [race.seconds[group[0], method, race.few]] if len(group) == 1 else []
                over = [race.seconds[scene, method, race.many] / race.seconds[scene, BASE, race.many] for scene in group]
                in_time = [race.samples_in_time(scene, method) for scene in group]
                row.append(f"{cost[0]:.4f}" if cost else "")
                row.append(f"{math.exp(mean([math.log(v) for v in over])):.3f}")
                row.append("" if None in in_time else f"{math.exp(mean([math.log(v) for v in in_time])):.1f}")
                out.writerow(row)


if __name__ == "__main__":
    main(sys.argv[1:])
