"""The error that the default filter predicts for plain renders, over the true one, and the cover of its intervals.

    python3 docs/results/plain_error.py DAPPLE FOLDER SEEDS SPP,SPP,... SCENE@WIDTHxHEIGHT ...

Two references of 128 spp per scene are made in FOLDER. Their noise cancels in a product of differences to both.
DAPPLE may be several programs, separated by commas: their columns follow each other. Needs numpy and OpenEXR.
"""
import pathlib
import subprocess
import sys

import numpy as np
import OpenEXR

from pfm import read as pfm


def main():
    programs, folder, seeds = sys.argv[1].split(","), pathlib.Path(sys.argv[2]), int(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)

    def name(scene):
        """The name of a bundled scene, or the folder's and the file's."""
        return "-".join(pathlib.Path(scene).with_suffix("").parts[-2:])

    def render(dapple, scene, size, out, *more):
        run = [dapple, "render", scene, "--resolution", size, "--pixel-filter", "box", *more, "-q", "-o", str(out)]
        subprocess.run(run, check=True, capture_output=True)

    def reference(scene, size, seed):
        path = folder / f"{name(scene)}-{seed}.pfm"
        if not path.exists():
            plain = ["--sampler", "uniform", "--filter", "none", "--spp", "128"]
            render(programs[0], scene, size, path, *plain, "--seed", str(seed))
        return pfm(path)[::-1]

    def box(plane, radius):
        side = 2 * radius + 1
        padded = np.pad(plane, radius, "edge")
        parts = [padded[y : y + plane.shape[0], x : x + plane.shape[1]] for y in range(side) for x in range(side)]
        return sum(parts) / side**2

    print("scene,spp," + ",".join(["predicted / true,least seed,largest seed,within 95 % interval"] * len(programs)))
    for spp in sys.argv[4].split(","):
        for scene, size in (scene.rsplit("@", 1) for scene in sys.argv[5:]):
            a, b = reference(scene, size, 98), reference(scene, size, 99)
            weight = 1 / (box((a + b).mean(2) / 2, 1) ** 2 + 0.01)
            noise = box(((a - b) ** 2).mean(2) / 4, 2)
            columns = []
            for dapple in programs:
                predicted, true, within = [], [], []
                for seed in range(1, seeds + 1):
                    out = folder / "image.exr"
                    render(dapple, scene, size, out, "--spp", spp, "--seed", str(seed))
                    with OpenEXR.File(str(out), separate_channels=True) as file:
                        plane = {name: np.asarray(channel.pixels, float) for name, channel in file.channels().items()}
                    x, error = np.stack([plane[c] for c in "RGB"], -1), plane["error.Y"]
                    true.append((((x - a) * (x - b)).mean(2) * weight).mean())
                    predicted.append((error * weight).mean())
                    apart = np.abs(x - (a + b) / 2).mean(2)
                    within.append((apart <= 1.96 * np.sqrt(box(error, 2) + noise)).mean())
                each = [p / t for p, t in zip(predicted, true)]
                ratio = sum(predicted) / sum(true)
                columns.append(f"{ratio:.2f},{min(each):.2f},{max(each):.2f},{np.mean(within):.3f}")
            print(f"{name(scene)},{spp}," + ",".join(columns), flush=True)

if __name__ == "__main__":
    main()
