"""Shared by other_renderer.py and other_renderer_cycles.py: errors, Open Image Denoise, and the ratio of two denoisers.

`python3 against_oidn.py TABLE.csv` prints for each column the error of each scene, and the geometric mean over the column "oidn" with its
interval of 95 % (seeds resampled within each scene).
"""
import csv
import math
import random
import sys

import numpy as np


def channels(path, layer="", letters="RGB"):
    """Three channels of a layer of an EXR file."""
    import OpenEXR

    found = OpenEXR.File(path, separate_channels=True).channels()
    return np.stack([found[(layer + "." if layer else "") + c].pixels.astype(np.float32) for c in letters], axis=-1)


def srgb(x):
    x = np.clip(np.nan_to_num(x), 0, 1)
    return 255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def error(image, truth):
    return float(np.mean((srgb(image) - srgb(truth)) ** 2))


def oidn(colour, albedo, normal):
    """Open Image Denoise with prefiltered albedo and normal."""
    import pyoidn

    device = pyoidn.Device()
    device.commit()
    planes = [np.ascontiguousarray(plane, np.float32) for plane in (colour, np.clip(albedo, 0, 1), np.clip(normal, -1, 1))]
    images = dict(zip((pyoidn.OIDN_IMAGE_COLOR, pyoidn.OIDN_IMAGE_ALBEDO, pyoidn.OIDN_IMAGE_NORMAL), planes))

    def run(inputs, **flags):
        output = np.zeros_like(colour, np.float32)
        f = pyoidn.Filter(device)
        for name, image in {**inputs, pyoidn.OIDN_IMAGE_OUTPUT: output}.items():
            f.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        for name, value in flags.items():
            f.set_bool(name, value)
        f.set_quality(pyoidn.OIDN_QUALITY_HIGH)
        f.commit()
        f.execute()
        return output

    for name in (pyoidn.OIDN_IMAGE_ALBEDO, pyoidn.OIDN_IMAGE_NORMAL):
        images[name] = run({name: images[name]})
    return run(images, hdr=True, cleanAux=True)


def summary(path):
    rows = list(csv.DictReader(open(path)))
    columns = [name for name in rows[0] if name not in ("scene", "seed")]
    scenes = {}
    for row in rows:
        scenes.setdefault(row["scene"], []).append({name: float(row[name]) for name in columns})
    mean = lambda rows, name: sum(row[name] for row in rows) / len(rows)
    ratio = lambda picked, name: math.exp(sum(math.log(mean(rows, name) / mean(rows, "oidn")) for rows in picked) / len(picked))
    for scene, rows in scenes.items():
        print(scene, *(f"{name} {mean(rows, name):.1f}" for name in columns), sep="  ")
    random.seed(1)
    for name in columns:
        draws = sorted(ratio([random.choices(rows, k=len(rows)) for rows in scenes.values()], name) for _ in range(2000))
        print(f"{name}: {ratio(list(scenes.values()), name):.3f} of oidn [{draws[50]:.3f}, {draws[1949]:.3f}]")


if __name__ == "__main__":
    summary(sys.argv[1])
