#!/usr/bin/env python3
"""oidn.py INPUT.exr OUTPUT.exr [--threads N] [--no-features | --prefilter]: Intel's Open Image Denoise on an EXR file of Dapple.

An external filter of `dapple study` (see docs/results/race.toml), and a program for files of `dapple render`. Needs Python 3.10 and, from PyPI,
    pip install numpy openexr==3.5.3 pyoidn==2.5.1.0
which installs OIDN 2.5 with its weights; `python3` in PATH must have them.

OIDN gets HDR colour, albedo and normal at its higher quality ("high"). The colour is the layer `unfiltered` if the file has one, else the
image. Features are weighted by the share of samples that hit something, the layer `coverage`, if the file has one. Features keep their noise; with --prefilter they are denoised first, each by a run of its own whose time
counts, and taken as clean. The reported time is that of the filter's execution alone, the shortest of three, once device, weights and
filter are ready. Starting Python, loading, and reading and writing files are not counted.
"""
import argparse
import json
import sys
import time


def main():
    p = argparse.ArgumentParser()
    p.add_argument("input")
    p.add_argument("output")
    p.add_argument("--threads", type=int, default=0)
    features = p.add_mutually_exclusive_group()
    features.add_argument("--no-features", action="store_true")
    features.add_argument("--prefilter", action="store_true")
    a = p.parse_args()

    try:
        import numpy as np
        import OpenEXR
        import pyoidn
    except ImportError as e:
        sys.exit(f"{e}: pip install numpy openexr==3.5.3 pyoidn==2.5.1.0, and have that python3 in PATH")

    with OpenEXR.File(a.input, separate_channels=True) as f:
        planes = {name: np.asarray(c.pixels, np.float32) for name, c in f.channels().items()}

    def layer(name, channels="RGB"):
        """A layer of three channels; `None` if the file lacks it."""
        names = [f"{name}.{c}" if name else c for c in channels]
        if not planes.keys() >= set(names):
            return None
        return np.ascontiguousarray(np.stack([planes[n] for n in names], -1))

    color = next((found for found in (layer("unfiltered"), layer("")) if found is not None), None)
    if color is None:
        sys.exit(f"{a.input}: no channels R, G and B; give an image of dapple")
    images = {pyoidn.OIDN_IMAGE_COLOR: color}
    if not a.no_features:
        albedo, normal = layer("albedo"), layer("normal", "XYZ")
        missing = [name for name, found in (("albedo", albedo), ("normal", normal)) if found is None]
        if missing:
            sys.exit(
                f"{a.input}: no layer {' and '.join(missing)}; render it with --features, or filter it without features by --no-features"
            )
        coverage = planes["coverage.Y"][..., None] if "coverage.Y" in planes else np.float32(1)
        images[pyoidn.OIDN_IMAGE_ALBEDO] = np.clip(albedo * coverage, 0, 1)
        images[pyoidn.OIDN_IMAGE_NORMAL] = np.clip(normal * coverage, -1, 1)

    device = pyoidn.Device()
    if a.threads > 0:
        device.set_int("numThreads", a.threads)
    device.commit()

    def check():
        error = device.get_error()
        if error:
            sys.exit(f"OIDN: {error}")

    def denoise(images, **switches):
        """The output for these images, and the seconds of the fastest of three executions."""
        output = np.zeros_like(next(iter(images.values())))
        f = pyoidn.Filter(device)
        for name, image in images.items():
            f.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        f.set_image(pyoidn.OIDN_IMAGE_OUTPUT, output, pyoidn.OIDN_FORMAT_FLOAT3)
        for name, value in switches.items():
            f.set_bool(name, value)
        f.set_quality(pyoidn.OIDN_QUALITY_HIGH)
        f.commit()
        check()
        best = float("inf")
        for _ in range(3):
            began = time.perf_counter()
            f.execute()
            best = min(best, time.perf_counter() - began)
            check()
        f.release()
        return output, best

    seconds = 0.0
    if a.prefilter:
        for name in (pyoidn.OIDN_IMAGE_ALBEDO, pyoidn.OIDN_IMAGE_NORMAL):
            images[name], took = denoise({name: images[name]})
            seconds += took
    output, took = denoise(images, hdr=True, cleanAux=a.prefilter)
    seconds += took
    if not np.isfinite(output).all():
        sys.exit("OIDN wrote values that are no numbers")
    with OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": output}) as f:
        f.write(a.output)
    print(json.dumps({"seconds": seconds, "threads": device.get_int("numThreads"), "prefiltered": a.prefilter}))

if __name__ == "__main__":
    main()
