#!/usr/bin/env python3
"""other_renderer.py DAPPLE [FOLDER [SEEDS]]: images of Mitsuba 3, denoised by `dapple denoise` and by Open Image Denoise, as CSV.

Five scenes of our own, 128x128 pixels, 16 spp: two halves of 8 spp with other seeds, and AOVs (albedo, shading normal, position). Open Image
Denoise gets the mean of both halves, and the same AOVs, prefiltered. "variance" is one file of 16 spp with second moments of image and
AOVs (Mitsuba's integrator `moment` around `aov`). Error: sRGB MSE against 1,024 spp. `against_oidn.py TABLE.csv` sums the table up.
Needs the Python packages mitsuba, pyoidn, OpenEXR and numpy.
"""
import math
import os
import subprocess
import sys

import mitsuba as mi
import numpy as np

from against_oidn import channels, error, oidn

mi.set_variant("scalar_rgb")
from mitsuba import ScalarTransform4f as T

SIDE = 128
AOVS = "albedo:albedo,nn:sh_normal,position:position"


def wall(colour, to_world):
    return {"type": "rectangle", "to_world": to_world, "bsdf": {"type": "twosided", "nested": {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}}}


def room(lamp, radiance, things):
    scene = {
        "type": "scene",
        "floor": wall([0.7, 0.65, 0.6], T().rotate([1, 0, 0], -90).scale(2)),
        "back": wall([0.6, 0.6, 0.7], T().translate([0, 2, -2]).scale(2)),
        "left": wall([0.7, 0.3, 0.2], T().translate([-2, 2, 0]).rotate([0, 1, 0], 90).scale(2)),
        "right": wall([0.3, 0.6, 0.3], T().translate([2, 2, 0]).rotate([0, 1, 0], -90).scale(2)),
        "ceiling": wall([0.8, 0.8, 0.8], T().translate([0, 4, 0]).rotate([1, 0, 0], 90).scale(2)),
        "lamp": {"type": "rectangle", "to_world": lamp, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}},
    }
    return {**scene, **things}


def ball(x, y, z, r, bsdf):
    return {"type": "sphere", "center": [x, y, z], "radius": r, "bsdf": bsdf}


def checker(a, b, times):
    texture = {"type": "checkerboard", "color0": {"type": "rgb", "value": a}, "color1": {"type": "rgb", "value": b}, "to_uv": T().scale([times, times, 1])}
    return {"type": "twosided", "nested": {"type": "diffuse", "reflectance": texture}}


def camera(origin, target, fov=45, lens=None):
    kind = {"type": "perspective"} if lens is None else {"type": "thinlens", "aperture_radius": lens, "focus_distance": math.dist(origin, target)}
    return {**kind, "fov": fov, "to_world": T().look_at(origin=origin, target=target, up=[0, 1, 0])}


GLASS = {"type": "dielectric"}
METAL = {"type": "roughconductor", "alpha": 0.15, "material": "Cu"}
PLASTIC = {"type": "roughplastic", "alpha": 0.1, "diffuse_reflectance": {"type": "rgb", "value": [0.2, 0.3, 0.7]}}
DOWN = T().rotate([1, 0, 0], 90)
BALLS = {"glass": ball(-0.7, 0.6, 0.3, 0.6, GLASS), "metal": ball(0.8, 0.7, -0.5, 0.7, METAL), "plastic": ball(0.4, 0.3, 0.9, 0.3, PLASTIC)}
SCENES = {
    "lamp": (room(T().translate([0, 3.99, 0]) @ DOWN @ T().scale(0.5), [12, 11, 9], BALLS), camera([0, 2, 6.5], [0, 1.7, 0])),
    "slit": (room(T().translate([-1.6, 3.99, 0]) @ DOWN @ T().scale([0.05, 1, 1]), [120, 110, 90], BALLS), camera([0, 2, 6.5], [0, 1.7, 0])),
    "indirect": (
        room(T().translate([0, 3.2, 0]) @ T().rotate([1, 0, 0], -90) @ T().scale(0.4), [25, 24, 22], {"metal": BALLS["metal"], "shade": wall([0.5] * 3, T().translate([0, 3.1, 0]) @ DOWN @ T().scale(0.6))}),
        camera([0, 2, 6.5], [0, 1.7, 0]),
    ),
    "sky": (
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(8), "bsdf": checker([0.1] * 3, [0.8] * 3, 16)},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 0.7, 1.0]}},
            "sun": {"type": "sphere", "center": [6, 9, 4], "radius": 1.0, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [60, 55, 45]}}},
            **BALLS,
        },
        camera([0, 2.2, 5.5], [0, 0.6, 0]),
    ),
    "lens": (
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(8), "bsdf": checker([0.2, 0.1, 0.1], [0.8, 0.7, 0.6], 24)},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.8, 0.8, 0.8]}},
            **{f"ball{i}": ball(-2 + 0.8 * i, 0.4, 2 - 1.2 * i, 0.4, [PLASTIC, METAL][i % 2]) for i in range(6)},
        },
        camera([0, 1.5, 5], [-0.4, 0.4, -0.4], 45, 0.12),
    ),
}


def render(name, spp, seed, kind="path"):
    """The image and AOVs as a Mitsuba bitmap with named channels."""
    world, sensor = SCENES[name]
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    path = {"type": "path", "max_depth": 12}
    integrator = path if kind == "plain" else {"type": "aov", "aovs": AOVS, "img": path}
    if kind == "moment":
        integrator = {"type": "moment", "nested": integrator}
    scene = mi.load_dict({**world, "sensor": {**sensor, "film": film, "sampler": {"type": "independent", "sample_count": spp}}, "integrator": integrator})
    mi.render(scene, spp=spp, seed=seed)
    return scene.sensors()[0].film().bitmap()


def main(dapple, folder, seeds):
    os.makedirs(folder, exist_ok=True)
    ours = lambda *arguments: subprocess.run([dapple, "denoise", *arguments], check=True, capture_output=True)
    print("scene,seed,noisy,dapple_halves,dapple_variance,oidn")
    for name in SCENES:
        reference = f"{folder}/{name}-reference.exr"
        if not os.path.exists(reference):
            render(name, 1024, 1000, "plain").write(reference)
        truth = channels(reference)
        for seed in range(seeds):
            halves = [f"{folder}/{name}-{seed}-{half}.exr" for half in "ab"]
            bitmaps = [render(name, 8, 2 * seed + half) for half in range(2)]
            for bitmap, path in zip(bitmaps, halves):
                bitmap.write(path)
            single = f"{folder}/{name}-{seed}-moment.exr"
            render(name, 16, 500 + seed, "moment").write(single)
            out = [f"{folder}/{name}-{seed}-{kind}.exr" for kind in ("halves", "variance")]
            ours(*halves, "--spp", "8", "-o", out[0])
            ours(single, "--spp", "16", "-o", out[1])
            split = [dict((key, np.array(value)) for key, value in bitmap.split()) for bitmap in bitmaps]
            mean = {key: (split[0][key].astype(np.float32) + split[1][key].astype(np.float32)) / 2 for key in split[0]}
            noisy = mean["<root>"][..., :3]
            images = [noisy, channels(out[0]), channels(out[1]), oidn(noisy, mean["albedo"], mean["nn"])]
            print(",".join([name, str(seed), *(f"{error(image, truth):.3f}" for image in images)]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "target/results/mitsuba", int(sys.argv[3]) if len(sys.argv) > 3 else 8)
