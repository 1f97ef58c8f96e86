"""data.py FOLDER FIRST END [STEP]: renders films of the random scenes FIRST, FIRST + STEP, ... below END to FOLDER/SEED.npz; resumes where it stopped.

Each scene is rendered at 1, 2 and 4 samples per pixel and at 8 or 16 without the network, and once at 64 with another seed by the default: its
filtered image is the target, its unfiltered image holds the energy. DAPPLE names the program.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR

OPTIONS = "--quiet --threads 1".split()
WITHOUT = "--filter cluster-regression:network=false".split()
# Scenes with smaller seeds use the box pixel filter; others state their own.
WIDE = 4000


def channels(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.asarray(c.pixels, np.float32) for name, c in file.channels().items()}


def film(path):
    """The planes of a film: c, v and n are mean, variance and count; a, m, z and k albedo, normal, depth and coverage; f and e image and error."""
    all = channels(path)
    layer = lambda prefix, names="RGB": np.stack([all[prefix + name] for name in names], -1)
    small = lambda values: np.clip(np.nan_to_num(values), -6e4, 6e4).astype(np.float16)
    unfiltered = "unfiltered." if "unfiltered.R" in all else ""
    return dict(
        c=np.nan_to_num(layer(unfiltered)),
        v=np.nan_to_num(layer("variance."), nan=-1).astype(np.float32),
        n=all["count.Y"].astype(np.uint16),
        a=small(layer("albedo.")),
        m=small(layer("normal.", "XYZ")),
        z=np.nan_to_num(all["depth.Y"], posinf=0),
        k=small(all["coverage.Y"]),
        f=layer(""),
        e=all["error.Y"],
    )


def make(scene, folder):
    work = folder / f"work-{scene}"
    scenes = Path(__file__).with_name("scenes.py")
    subprocess.run([sys.executable, scenes, str(scene), work], check=True)

    def render(spp, seed, name, *options):
        command = [
            os.environ.get("DAPPLE", "dapple"),
            "render",
            work / "s.pbrt",
            *OPTIONS,
            *(["--pixel-filter", "box"] if scene < WIDE else []),
            "--spp",
            str(spp),
            "--seed",
            str(seed),
            "-o",
            work / name,
            *options,
        ]
        subprocess.run(command, check=True, timeout=90, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return film(work / name)

    target = render(64, 901, "target.exr")
    planes = {f"r.{key}": target[key] for key in "cvnf"}
    more = int(np.random.default_rng(scene + 10**6).choice([8, 16]))
    for spp in (1, 2, 4, more):
        planes |= {f"a{spp}.{key}": plane for key, plane in render(spp, scene + spp, "film.exr", *WITHOUT).items()}
    np.savez(work / "all.npz", **planes)
    os.replace(work / "all.npz", folder / f"{scene}.npz")
    shutil.rmtree(work)


if __name__ == "__main__":
    folder, (first, end, *step) = Path(sys.argv[1]), map(int, sys.argv[2:])
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(first, end, *step):
        if (folder / f"{seed}.npz").exists():
            continue
        try:
            make(seed, folder)
        except subprocess.SubprocessError as error:
            print(f"left out: scene {seed}: {error}", file=sys.stderr)
            shutil.rmtree(folder / f"work-{seed}", ignore_errors=True)
