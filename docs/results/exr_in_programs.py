"""Checks an EXR file of dapple with OpenEXR's own library and in Blender.

    python exr_in_programs.py DAPPLE DIR      needs OpenEXR, numpy and bpy (PyPI)

Names, types and values of the layers must be those that dapple's page on layers states, the description in the header must
render the same image again, and the camera's matrices must take the point under a pixel back to that pixel. Blender must
list every layer as a pass, and its compositor must write the values of each. Prints the versions of both; exits with 1 if
anything differs.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR


def check(what, right):
    print(("ok    " if right else "WRONG ") + what)
    return bool(right)


def read(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: c.pixels for name, c in file.channels().items()}


def in_openexr(path, dapple):
    header, planes = read(path)
    print("      OpenEXR", OpenEXR.__version__)
    names = {"R", "G", "B", "A", "Z", "albedo.R", "normal.X", "depth.Y", "coverage.Y", "count.Y", "variance.G"}
    fine = check("OpenEXR finds the channels", names <= planes.keys())
    fine &= check("counts are integers", planes["count.Y"].dtype == np.uint32)
    fine &= check("A is the coverage", np.array_equal(planes["A"], planes["coverage.Y"]))
    fine &= check("software names dapple", header["software"].startswith("dapple "))
    fine &= check("the command is there", "render" in header["dapple:command"])
    spec = path.with_name("spec.json")
    spec.write_text(header["dapple:spec"])
    fine &= check("the description names scene and budget", json.loads(header["dapple:spec"])["budget"] == {"spp": 8.0})
    again = path.with_name("again.exr")
    subprocess.run([dapple, "render", "--spec", str(spec), "-q", "-o", str(again)], check=True)
    same = all(np.array_equal(plane, read(again)[1][name], equal_nan=True) for name, plane in planes.items())
    fine &= check("the description renders the same bits", same)
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
    print("      Blender", bpy.app.version_string)
    return fine & values_in_blender(bpy, node, path.parent, planes)


def values_in_blender(bpy, node, directory, planes):
    """Compares the values of every pass that Blender's compositor writes into files of its own."""
    scene, tree = bpy.context.scene, bpy.context.scene.node_tree
    channels = {"Combined": "RGB", "Alpha": ["A"], "Depth": ["Z"]}
    for name in planes:
        layer, _, channel = name.partition(".")
        if channel:
            channels.setdefault(layer, [])
            channels[layer].append(name)
    files = tree.nodes.new("CompositorNodeOutputFile")
    files.base_path = str(directory / "passes")
    files.format.file_format, files.format.color_depth, files.format.color_mode = "OPEN_EXR", "32", "RGB"
    files.file_slots.clear()
    for name in channels:
        files.file_slots.new(name)
        tree.links.new(node.outputs[name], files.inputs[name])
    height, width = planes["R"].shape
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    # Blender composes only what it renders; an empty scene with a camera is enough.
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.filepath = str(directory / "composed")
    bpy.ops.render.render(write_still=False)
    fine = True
    for name, sources in channels.items():
        (file,) = (directory / "passes").glob(f"{name}[0-9]*.exr")
        found = read(file)[1]
        # The order of a layer's channels in Blender, whatever that in the file.
        ordered = sorted(sources, key=lambda s: "RGBXYZ".index(s[-1]) if s[-1] in "RGBXYZ" else 0)
        ours = [np.float32(planes[source]) for source in ordered] * (3 if len(sources) == 1 else 1)
        # A pass of one channel may become a file of one channel, whatever its name.
        theirs = [found.get(c, next(iter(found.values()))) for c in "RGB"]
        same = all(np.allclose(a, b, rtol=1e-6, atol=0, equal_nan=True) for a, b in zip(theirs, ours))
        fine &= check(f"Blender has the values of {name}", same)
    return fine


def main():
    dapple, directory = sys.argv[1], Path(sys.argv[2])
    directory.mkdir(parents=True, exist_ok=True)
    path = directory.resolve() / "layers.exr"
    subprocess.run([dapple, "render", "teapot", "--spp", "8", "--resolution", "96x60", "-q", "-o", str(path)], check=True)
    fine, planes = in_openexr(path, dapple)
    fine &= in_blender(path, planes)
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
