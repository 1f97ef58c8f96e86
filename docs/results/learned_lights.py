#!/usr/bin/env python3
"""learned_lights.py STUDY...: the gain of learned light selection, from folders of `dapple study docs/results/learned-lights.toml`.

Prints Markdown: per scene `NAME-learned` over `NAME` (sRGB MSE / relMSE), geometric means over paired seeds; over all scenes with 95 %
intervals of the seeds (Student's t), the scenes taken as they are. Times are CPU seconds.
"""
import json
import math
import sys
from collections import defaultdict

QUANTILE = {2: 12.71, 3: 4.303, 4: 3.182, 6: 2.571, 8: 2.365, 16: 2.131}


def main():
    runs = defaultdict(dict)
    for folder in sys.argv[1:]:
        for line in open(f"{folder}/runs.jsonl"):
            run = json.loads(line)
            runs[run["scene"], run["method"]["filter"], run["budget"]["spp"]][run["seed"]] = run
    scenes = [name[: -len("-learned")] for name in dict.fromkeys(s for s, _, _ in runs) if name.endswith("-learned")]
    budgets = sorted({spp for _, _, spp in runs})

    def value(run, what):
        return run["cpu_s"] if what == "time" else run["errors"][what]

    def logs(above, below, what):
        a, b = runs[above], runs[below]
        return [math.log(value(a[s], what) / value(b[s], what)) for s in sorted(a)]

    def mean(values):
        return sum(values) / len(values)

    def interval(values):
        n, middle = len(values), mean(values)
        half = QUANTILE[n] * math.sqrt(sum((x - middle) ** 2 for x in values) / (n - 1) / n)
        return "%.3f [%.3f, %.3f]" % tuple(math.exp(x) for x in (middle, middle - half, middle + half))

    PLAIN, FILTERED = "none", "cluster-regression"
    COLUMNS = [
        ("`uniform`, none: learned over power", "-learned", PLAIN, "", PLAIN),
        ("default: learned over power", "-learned", FILTERED, "", FILTERED),
        ("default, learned, over `uniform`, by power", "-learned", FILTERED, "", PLAIN),
        ("default, by power, over that", "", FILTERED, "", PLAIN),
    ]
    for spp in budgets:
        print(f"| {spp} spp | " + " | ".join(name for name, *_ in COLUMNS) + " |")
        print("|---" * (1 + len(COLUMNS)) + "|")
        sums = defaultdict(list)
        for scene in scenes:
            row = [scene]
            for i, (_, a, fa, b, fb) in enumerate(COLUMNS):
                above, below = (scene + a, fa, spp), (scene + b, fb, spp)
                found = {what: logs(above, below, what) for what in ("srgb8_mse", "relmse", "flip", "time")}
                for what, values in found.items():
                    sums[i, what].append(values)
                row.append("%.3f / %.3f" % (math.exp(mean(found["srgb8_mse"])), math.exp(mean(found["relmse"]))))
            print("| " + " | ".join(row) + " |")
        for what, name in (("srgb8_mse", "sRGB MSE"), ("relmse", "relMSE"), ("flip", "FLIP"), ("time", "CPU seconds")):
            over = [interval([mean(seed) for seed in zip(*sums[i, what])]) for i in range(len(COLUMNS))]
            print(f"| **all, {name}** | " + " | ".join(over) + " |")
        print()

if __name__ == "__main__":
    main()
