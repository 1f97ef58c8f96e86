"""Checks an EXR file of dapple with OpenEXR's own library and in Blender.

    python exr_in_programs.py DAPPLE DIR      needs OpenEXR, numpy and bpy (PyPI)

Names, types and values of the layers must be those that dapple's page on layers states, the camera's matrices must take the
point under a pixel back to that pixel, and Blender must list every layer as a pass. Exits with 1 if anything differs.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR


def check(what, right):
    print(("ok    " if right else "WRONG ") + what)
    return bool(right)


def in_openexr(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, planes = dict(file.header()), {name: c.pixels for name, c in file.channels().items()}
    names = {"R", "G", "B", "A", "Z", "albedo.R", "normal.X", "depth.Y", "coverage.Y", "count.Y", "variance.G"}
    fine = check("OpenEXR finds the channels", names <= planes.keys())
    fine &= check("counts are integers", planes["count.Y"].dtype == np.uint32)
    fine &= check("A is the coverage", np.array_equal(planes["A"], planes["coverage.Y"]))
    fine &= check("software names dapple", header["software"].startswith("dapple "))
    fine &= check("the command is there", "render" in header["dapple:command"])
    hit = planes["A"] == 1
    fine &= check("Z is at most the length of the path", np.all(planes["Z"][hit] <= planes["depth.Y"][hit] * (1 + 1e-5)))
    fine &= check("Z is 1e10 in the background", np.all(planes["Z"][planes["A"] == 0] == np.float32(1e10)))
    to_camera, to_ndc = (np.float64(header[name]).reshape(4, 4) for name in ("worldToCamera", "worldToNDC"))
    height, width = hit.shape
    worst = 0
    for y, x in np.argwhere(hit)[::97]:
        ndc = np.array([2 * (x + 0.5) / width - 1, 1 - 2 * (y + 0.5) / height])
        # The point at this Z whose image is the pixel's centre.
        camera_to_ndc = np.linalg.inv(to_camera) @ to_ndc
        z = float(planes["Z"][y, x])
        scale = np.array([camera_to_ndc[0, 0], camera_to_ndc[1, 1]])
        point = np.array([*(ndc / scale * z), z, 1.0]) @ np.linalg.inv(to_camera)
        back = point @ to_ndc
        worst = max(worst, np.abs(back[:2] / back[3] - ndc).max())
    return fine & check(f"the matrices agree (worst {worst:.1e})", worst < 1e-4), planes


def in_blender(path, planes):
    import bpy

    image = bpy.data.images.load(str(path))
    scene = bpy.context.scene
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    names = {output.name for output in node.outputs}
    print("      Blender's passes:", ", ".join(sorted(names)))
    layers = {name.split(".")[0] for name in planes if "." in name}
    fine = check("Blender lists every layer, with alpha and depth", layers | {"Combined", "Alpha", "Depth"} <= names)
    return fine


def main():
    dapple, directory = sys.argv[1], Path(sys.argv[2])
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / "layers.exr"
    subprocess.run([dapple, "render", "teapot", "--spp", "8", "--resolution", "96x60", "-q", "-o", str(path)], check=True)
    fine, planes = in_openexr(path)
    fine &= in_blender(path, planes)
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
