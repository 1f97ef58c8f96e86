#!/usr/bin/env python3
"""ratios.py FOLDER [--scene NAME] [METRIC]...: errors of a study's methods over its baseline's as a Markdown table.

A row for each budget and method, a column for each scene, and the geometric mean of the scenes. A cell has a ratio for each METRIC of
runs.jsonl (srgb8_mse and relmse unless named), the geometric mean over paired seeds. One METRIC alone has the 95 % interval of its mean
over seeds. --scene takes the baseline's errors in that scene for all scenes, such as light selections of one scene.
"""
import argparse
import math

from study_tables import Study, interval


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("folder")
    parser.add_argument("--scene")
    parser.add_argument("metrics", nargs="*")
    chosen = parser.parse_args()
    study, metrics = Study(chosen.folder), chosen.metrics or ["srgb8_mse", "relmse"]

    def ratios(scene, method, budget, metric):
        """The ratio of each seed; a time is that of the baseline at so many spp, whose error the others are over."""
        of = lambda scene, method, budget: study.runs.get((scene, method, budget), {})
        above, below = of(scene, method, budget), of(chosen.scene or scene, study.baseline, ("spp", budget[1]))
        errors = [(above[seed]["errors"][metric], below[seed]["errors"][metric]) for seed in sorted(above.keys() & below.keys())]
        return [a / b for a, b in errors if min(a, b) > 0]

    mean = lambda values: math.exp(sum(map(math.log, values)) / len(values)) if values else math.nan
    print("| budget | case | " + " | ".join(study.scenes) + " | geometric mean |\n|" + "---|" * (3 + len(study.scenes)))
    times = [("time_of", study.settings["time_of"])] if study.settings["time_of"] else []
    for budget in [("spp", spp) for spp in study.settings["spp"]] + times:
        name = f"time of {budget[1]} spp" if budget in times else f"{budget[1]} spp"
        for method in study.methods:
            found = [[ratios(scene, method, budget, metric) for metric in metrics] for scene in study.scenes]
            if all(found[0]):
                cells = [" / ".join(f"{mean(of):.3f}" for of in scene) for scene in found]
                alone = interval([mean(seed) for seed in zip(*(scene[0] for scene in found))])
                means = " / ".join(f"{mean([mean(of) for of in column]):.3f}" for column in zip(*found))
                print(f"| {name} | {study.names[method]} | " + " | ".join(cells) + f" | {alone if len(metrics) == 1 else means} |")


if __name__ == "__main__":
    main()
