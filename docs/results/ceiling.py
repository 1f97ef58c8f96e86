#!/usr/bin/env python3
"""ceiling.py [PROGRAM]: how much counts can gain on the scenes of methods.toml, beside what they gain (tables/methods.csv).

If a pixel's squared error is s^2 / n, counts in proportion to s leave mean(s)^2 / mean(s^2) = 1 / (1 + CV(s)^2) of the error of
equal counts. s is the deviation of uniform Sobol' sampling's pixel means at 32 spp over 16 seeds, in clamped sRGB. The root of an
estimated variance is too small on average; the printed ceilings are divided by its square for 15 degrees of freedom.

PROGRAM is target/release/dapple unless given. A minute on one idle core.
"""
import array
import csv
import math
import os
import subprocess
import sys
import tempfile
import tomllib

SEEDS = 16
METHODS = ["variance", "ears", "adaptive", "ucb", "cycles", "cluster-thesis"]


def pixels(path):
    with open(path, "rb") as file:
        head = [file.readline() for _ in range(3)]
        values = array.array("f", file.read())
    if float(head[2]) > 0:
        values.byteswap()
    return values


def encoded(v):
    v = min(max(v, 0.0), 1.0)
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


def ceiling(program, scene, spp):
    with tempfile.TemporaryDirectory() as folder:
        images = []
        for seed in range(SEEDS):
            path = os.path.join(folder, f"{seed}.pfm")
            command = [program, "render", scene["source"], "--resolution", scene["resolution"], "--spp", str(spp), "--seed", str(seed)]
            command += ["--sampler", "uniform", "--points", "sobol", "--filter", "none", "--pixel-filter", "box", "--threads", "1"]
            subprocess.run(command + ["--quiet", "-o", path], check=True)
            images.append([encoded(v) for v in pixels(path)])
    variances = []
    for values in zip(*images):
        mean = sum(values) / SEEDS
        variances.append(sum((v - mean) ** 2 for v in values) / (SEEDS - 1))
    of_pixels = [sum(variances[i : i + 3]) for i in range(0, len(variances), 3)]
    roots = sum(math.sqrt(v) for v in of_pixels) / len(of_pixels)
    free = SEEDS - 1
    root_bias = math.sqrt(2 / free) * math.gamma((free + 1) / 2) / math.gamma(free / 2)
    return (roots / root_bias) ** 2 / (sum(of_pixels) / len(of_pixels))


def main(program):
    here = os.path.dirname(os.path.abspath(__file__))
    with open(f"{here}/methods.toml", "rb") as file:
        plan = tomllib.load(file)
    spp = max(plan["spp"])
    with open(f"{here}/tables/methods.csv", newline="") as file:
        found = {(line["scene"], line["method"]): line[f"srgb_mse, {spp} spp"] for line in csv.DictReader(file)}
    print("| scene | ceiling |", " | ".join(f"`{m}`" for m in METHODS), "|")
    print("|---|---|" + "---|" * len(METHODS))
    logs = []
    for scene in plan["scenes"]:
        least = ceiling(program, scene, spp)
        logs.append(math.log(least))
        cells = [found.get((scene["name"], f"{m}/sobol/none"), "") for m in METHODS]
        print(f"| {scene['name']} | {least:.2f} |", " | ".join(f"{float(c):.2f}" if c else "" for c in cells), "|", flush=True)
    cells = [found[("all", f"{m}/sobol/none")] for m in METHODS]
    print(f"| **all** | {math.exp(sum(logs) / len(logs)):.2f} |", " | ".join(f"{float(c):.2f}" for c in cells), "|")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "target/release/dapple")
