"""Compares dapple's images of glTF files with those of Blender's Cycles: the same file, camera and lights.

    python gltf_cycles.py DAPPLE DIR [FILE...]      needs bpy 4.2 (PyPI), numpy and OpenEXR

Ten spheres of ten materials are made here. They are rendered under three lamps, under the same lamps with Cycles' single
scattering between microfacets, and inside a white shell, where a surface shows the share of light that it reflects. Each
FILE is rendered as it is, and with all of its materials made matte. A file without a camera or a light gets one here, so
that both programs read them from the same file. Prints ratios, Dapple's mean over Cycles': of each sphere, and of blocks
of 16x16 pixels.
"""

import base64
import json
import math
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np

SIZE = (192, 128)
BLOCK = 16
SAMPLES = 256


def read(path):
    """The JSON of a file with all of its buffers and images as data URIs."""
    data = path.read_bytes()
    blob = b""
    if data[:4] == b"glTF":
        length = struct.unpack("<I", data[12:16])[0]
        text = data[20 : 20 + length]
        rest = data[20 + length :]
        blob = rest[8 : 8 + struct.unpack("<I", rest[:4])[0]] if rest else b""
        document = json.loads(text)
    else:
        document = json.loads(data)
    for thing in document.get("buffers", []) + document.get("images", []):
        uri = thing.get("uri", "")
        if "uri" in thing and not uri.startswith("data:"):
            kind = "image/png" if uri.endswith("png") else "image/jpeg" if uri.endswith("jpg") else "application/octet-stream"
            thing["uri"] = f"data:{kind};base64," + base64.b64encode((path.parent / uri).read_bytes()).decode()
        elif "uri" not in thing and "bufferView" not in thing:
            thing["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    return document


def add_buffer(document, array, kind, target=None):
    """Adds an array as an accessor of its own buffer; returns the accessor's index."""
    array = np.ascontiguousarray(array)
    code = {np.dtype("float32"): 5126, np.dtype("uint32"): 5125}[array.dtype]
    uri = "data:application/octet-stream;base64," + base64.b64encode(array.tobytes()).decode()
    document.setdefault("buffers", []).append({"byteLength": array.nbytes, "uri": uri})
    document.setdefault("bufferViews", []).append({"buffer": len(document["buffers"]) - 1, "byteLength": array.nbytes})
    accessor = {"bufferView": len(document["bufferViews"]) - 1, "componentType": code, "count": len(array), "type": kind}
    if kind == "VEC3":
        accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
    document.setdefault("accessors", []).append(accessor)
    return len(document["accessors"]) - 1


def add_mesh(document, positions, normals, triangles, material):
    attributes = {"POSITION": add_buffer(document, np.float32(positions), "VEC3")}
    if normals is not None:
        attributes["NORMAL"] = add_buffer(document, np.float32(normals), "VEC3")
    indices = add_buffer(document, np.uint32(triangles).reshape(-1), "SCALAR")
    part = {"attributes": attributes, "indices": indices, "material": material}
    document.setdefault("meshes", []).append({"primitives": [part]})
    return len(document["meshes"]) - 1


def add_node(document, node):
    document.setdefault("nodes", []).append(node)
    scene = document.setdefault("scenes", [{"nodes": []}])[document.get("scene", 0)]
    scene.setdefault("nodes", []).append(len(document["nodes"]) - 1)


def look(eye, at):
    """The rotation (quaternion) of a node that looks from `eye` to `at` along its -z."""
    back = np.subtract(eye, at) / np.linalg.norm(np.subtract(eye, at))
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    m = np.column_stack([right, np.cross(back, right), back])
    w = math.sqrt(max(0, 1 + m.trace())) / 2
    return [(m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w), w]


def add_camera(document, eye, at, yfov):
    perspective = {"yfov": yfov, "aspectRatio": SIZE[0] / SIZE[1], "znear": 0.01, "zfar": 10000}
    document.setdefault("cameras", []).append({"type": "perspective", "perspective": perspective})
    camera = len(document["cameras"]) - 1
    add_node(document, {"camera": camera, "translation": list(eye), "rotation": look(eye, at)})


def add_light(document, light, eye, at):
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", []), "KHR_lights_punctual"})
    lights = document.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
    lights.append(light)
    extension = {"KHR_lights_punctual": {"light": len(lights) - 1}}
    add_node(document, {"extensions": extension, "translation": list(eye), "rotation": look(eye, at)})


def material(color, metallic=0.0, roughness=0.5, **more):
    pbr = {"baseColorFactor": [*color, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
    return {"pbrMetallicRoughness": pbr, **more}


def matte(color):
    return material(color, 0, 1, extensions={"KHR_materials_specular": {"specularFactor": 0.0}})


def ground(document, y, half):
    document.setdefault("materials", []).append(matte([0.32, 0.31, 0.30]))
    corners = [[-half, y, half], [half, y, half], [half, y, -half], [-half, y, -half]]
    mesh = add_mesh(document, corners, None, [[0, 1, 2], [0, 2, 3]], len(document["materials"]) - 1)
    add_node(document, {"mesh": mesh})


SPHERES = {
    "matte": matte([0.7, 0.2, 0.1]),
    "plastic, rough 1": material([0.7, 0.2, 0.1], 0, 1.0),
    "plastic, rough 0.6": material([0.7, 0.2, 0.1], 0, 0.6),
    "plastic, rough 0.25": material([0.7, 0.2, 0.1], 0, 0.25),
    "metal, rough 0.3": material([0.9, 0.7, 0.3], 1, 0.3),
    "metal, rough 0.8": material([0.9, 0.7, 0.3], 1, 0.8),
    "half metal": material([0.9, 0.7, 0.3], 0.5, 0.4),
    "coated": material([0.1, 0.3, 0.7], 0, 0.8, extensions={"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.3}}),
    "lamp": material([0, 0, 0], 0, 1, emissiveFactor=[1, 0.8, 0.5], extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 2}, "KHR_materials_specular": {"specularFactor": 0.0}}),
    "glass, rough 0.3": material([1, 1, 1], 0, 0.3, extensions={"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_volume": {"thicknessFactor": 1.0}}),
}


EYE, AT, YFOV = np.array([0, 7, 11]), np.array([0, 0.6, 0]), 0.62
CENTRES = np.array([[2.3 * (k % 5 - 2), 1.0, 2.6 * (k // 5) - 1.0] for k in range(len(SPHERES))])


def sphere(rings, around):
    """Corners and triangles of a sphere of radius 1."""
    angles = [(math.pi * i / rings, 2 * math.pi * j / around) for i in range(rings + 1) for j in range(around + 1)]
    points = [(math.sin(a) * math.cos(b), math.cos(a), math.sin(a) * math.sin(b)) for a, b in angles]
    faces = []
    for i in range(rings):
        for j in range(around):
            a = i * (around + 1) + j
            b = a + around + 1
            faces += [[a, a + 1, b + 1]] * (i > 0) + [[a, b + 1, b]] * (i < rings - 1)
    return points, faces


def spheres(in_shell):
    """Ten spheres on a ground under lamps, or inside a shell that shines evenly."""
    document = {"asset": {"version": "2.0"}, "materials": list(SPHERES.values())}
    used = {name for m in SPHERES.values() for name in m.get("extensions", {})}
    document["extensionsUsed"] = sorted(used)
    points, faces = sphere(48, 96)
    for k, centre in enumerate(CENTRES):
        mesh = add_mesh(document, points, points, faces, k)
        add_node(document, {"mesh": mesh, "translation": centre.tolist()})
    if in_shell:
        shining = {"KHR_materials_specular": {"specularFactor": 0.0}}
        document["materials"].append(material([0, 0, 0], 0, 1, emissiveFactor=[0.5] * 3, doubleSided=True, extensions=shining))
        points, faces = sphere(8, 16)
        mesh = add_mesh(document, 60 * np.array(points), None, faces, len(document["materials"]) - 1)
        add_node(document, {"mesh": mesh})
    else:
        ground(document, 0, 30)
        lit(document, 6)
    add_camera(document, EYE.tolist(), AT.tolist(), YFOV)
    return document


def sphere_of_pixels():
    """The number of the sphere that each pixel shows; -1 elsewhere and near the edges of spheres."""
    back = (EYE - AT) / np.linalg.norm(EYE - AT)
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    up, (width, height) = np.cross(back, right), SIZE
    x = (2 * (np.arange(width) + 0.5) / width - 1) * math.tan(YFOV / 2) * width / height
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * math.tan(YFOV / 2)
    rays = x[None, :, None] * right + y[:, None, None] * up - back
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ (CENTRES - EYE).T
    beside = np.sqrt(np.maximum(0, ((CENTRES - EYE) ** 2).sum(-1) - along**2))
    nearest = np.where(beside < 1, along, np.inf).argmin(-1)
    inside = np.take_along_axis(beside, nearest[..., None], -1)[..., 0] < 0.93
    return np.where(inside, nearest, -1)


def lit(document, size):
    add_light(document, {"type": "directional", "intensity": 1400, "color": [1, 0.95, 0.9]}, [0, 0, 0], [-0.5, -1, -0.6])
    point = {"type": "point", "intensity": 683 * 0.4 * size * size, "color": [0.8, 0.9, 1]}
    add_light(document, point, [-0.8 * size, 1.2 * size, 0.9 * size], [0, 0, 0])
    spot = {"type": "spot", "intensity": 683 * 0.6 * size * size, "spot": {"innerConeAngle": 0.0, "outerConeAngle": 0.5}}
    add_light(document, spot, [1.0 * size, 1.0 * size, 0.6 * size], [0, 0, 0])


def staged(path):
    """A file with a camera, lights and ground where it has none."""
    document = read(path)
    shines = any(any(m.get("emissiveFactor", [])) for m in document.get("materials", []))
    bare = not document.get("cameras")
    if "CornellBox" in path.name:
        add_camera(document, [-278, 273, 800], [-278, 273, 0], 0.69)
    elif bare:
        add_camera(document, [2.2, 1.6, 3.4], [0, 0, 0], 0.6)
    if not shines and "KHR_lights_punctual" not in document.get("extensions", {}):
        ground(document, -1.2, 30)
        lit(document, 2.5)
    return document


def made_matte(document):
    """The same file with materials that only reflect diffusely, in the same colours."""
    document = json.loads(json.dumps(document))
    for thing in document.get("materials", []):
        pbr = thing.setdefault("pbrMetallicRoughness", {})
        pbr.pop("metallicRoughnessTexture", None)
        pbr |= {"metallicFactor": 0, "roughnessFactor": 1}
        thing["extensions"] = {**thing.get("extensions", {}), "KHR_materials_specular": {"specularFactor": 0.0}}
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", []), "KHR_materials_specular"})
    return document


def by_cycles(file, out, distribution="MULTI_GGX"):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(file))
    scene = bpy.context.scene
    scene.camera = next(o for o in scene.objects if o.type == "CAMERA")
    for lamp in (o.data for o in scene.objects if o.type == "LIGHT"):
        if lamp.type == "SUN":
            lamp.angle = 0
        else:
            lamp.shadow_soft_size = 0  # Blender gives lights of the file a radius.
    for node in (n for m in bpy.data.materials if m.use_nodes for n in m.node_tree.nodes):
        if node.type == "BSDF_PRINCIPLED":
            node.distribution = distribution
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = SAMPLES, False, False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 12
    cycles.blur_glossy = 0
    cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(out)
    bpy.ops.render.render(write_still=True)


def pixels(path):
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        names = file.channels()
        return np.stack([np.float64(names[c].pixels) for c in "RGB"], -1)


def compare(name, ours, theirs):
    h, w = (n // BLOCK for n in ours.shape[:2])
    blocks = [i[: h * BLOCK, : w * BLOCK].reshape(h, BLOCK, w, BLOCK, 3).mean((1, 3, 4)) for i in (ours, theirs)]
    dark = 0.01 * blocks[1].mean()
    ratio = (blocks[0] + dark) / (blocks[1] + dark)
    agree = 100 * (np.abs(ratio - 1) <= 0.03).mean()
    print(f"{name}: mean {ours.mean() / theirs.mean():.4f}; blocks within 3 %: {agree:.1f}, least {ratio.min():.3f}, "
          f"median {np.median(ratio):.4f}, largest {ratio.max():.3f}", flush=True)  # fmt: skip
    return ratio


def by_both(dapple, directory, name, document, distribution="MULTI_GGX"):
    """Both images of a scene; prints the ratio of blocks."""
    file = directory / f"{name}.gltf"
    file.write_text(json.dumps(document))
    ours, theirs = directory / f"{name}-dapple.exr", directory / f"{name}-cycles.exr"
    subprocess.run([dapple, "render", str(file), "-o", str(ours), "--resolution", f"{SIZE[0]}x{SIZE[1]}", "--spp", str(SAMPLES),
                    "--filter", "none", "--sampler", "uniform", "-q"], check=True)  # fmt: skip
    by_cycles(file, theirs, distribution)
    ours, theirs = pixels(ours), pixels(theirs)
    np.savetxt(directory / f"{name}-ratio.txt", compare(name, ours, theirs), fmt="%.3f")
    return ours, theirs


def main():
    dapple, directory, *files = sys.argv[1:]
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    shown = sphere_of_pixels()
    for name, in_shell, distribution in [
        ("lamps", False, "MULTI_GGX"),
        ("lamps-single-scattering", False, "GGX"),
        ("shell", True, "MULTI_GGX"),
    ]:
        ours, theirs = by_both(dapple, directory, name, spheres(in_shell), distribution)
        for k, what in enumerate(SPHERES):
            mask = shown == k
            print(f"{name}, {what}: {ours[mask].mean() / theirs[mask].mean():.4f}", flush=True)
    for file in map(Path, files):
        document = staged(file)
        by_both(dapple, directory, f"{file.stem}-matte", made_matte(document))
        by_both(dapple, directory, file.stem, document)


if __name__ == "__main__":
    main()
