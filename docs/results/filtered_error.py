"""The relMSE at which `dapple render --error` ends, over the requested one, for the filtered image.

    python3 docs/results/filtered_error.py DAPPLE FOLDER SEEDS SCENE=RELMSE ...

Two references of 4096 spp per scene are made in FOLDER; their noise cancels in a product of differences to both.
"""
import json
import pathlib
import statistics
import subprocess
import sys

import numpy as np

from pfm import read as pfm


def main():
    dapple, folder, seeds = sys.argv[1], pathlib.Path(sys.argv[2]), int(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)

    def render(scene, out, *more):
        size = ["--resolution", "160x120", "--pixel-filter", "box"]
        run = [dapple, "render", scene, *size, *more, "--json", "-o", str(out)]
        return json.loads(subprocess.run(run, check=True, capture_output=True, text=True).stdout.splitlines()[-1])

    def reference(scene, seed):
        path = folder / f"{pathlib.Path(scene).stem}-{seed}.pfm"
        if not path.exists():
            render(scene, path, "--sampler", "uniform", "--filter", "none", "--spp", "4096", "--seed", str(seed))
        return pfm(path)

    print("scene,asked,true / asked,standard error,predicted / true,spp")
    for scene, asked in (pair.split("=") for pair in sys.argv[4:]):
        a, b = reference(scene, 98), reference(scene, 99)
        weight = 1 / ((a + b) ** 2 / 4 + 0.01)
        true, predicted, spp = [], [], []
        for seed in range(1, seeds + 1):
            out = folder / "image.pfm"
            line = render(scene, out, "--error", asked, "--seed", str(seed))
            x = pfm(out)
            true.append(((x - a) * (x - b) * weight).mean())
            predicted.append(line["predicted_relmse_filtered"])
            spp.append(line["spp"])
        over = [t / float(asked) for t in true]
        ratio = sum(predicted) / sum(true)
        mean, error = statistics.mean(over), statistics.stdev(over) / seeds**0.5
        print(f"{scene},{asked},{mean:.2f},{error:.2f},{ratio:.2f},{statistics.mean(spp):.1f}", flush=True)

if __name__ == "__main__":
    main()
