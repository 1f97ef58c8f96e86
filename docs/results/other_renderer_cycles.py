#!/usr/bin/env python3
"""other_renderer_cycles.py DAPPLE [FOLDER [SEEDS]]: images of Cycles, denoised by `dapple denoise` and by Open Image Denoise, as CSV.

Five scenes of our own, 160x120 pixels, 16 spp: two files of 8 spp with other seeds, as Blender writes them (OpenEXR MultiLayer, 32 bits), with
the passes Combined, Position and Denoising Data (normal, albedo, depth). Open Image Denoise gets the mean of both files, and prefiltered
albedo and normal. "dapple_first_hits" reads the passes Normal, DiffCol and Depth of the first hit instead. Error: sRGB MSE against
1,024 spp. Needs the Python packages bpy (4.2, for Python 3.11), pyoidn, OpenEXR and numpy.
"""
import math
import os
import subprocess
import sys
from contextlib import contextmanager

import bpy
from mathutils import Vector

from against_oidn import channels, error, oidn

SIZE = (160, 120)
REFERENCE = 1024


def material(name, **inputs):
    """A Principled BSDF with these inputs; a value that is a function makes a node for it."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        socket = shader.inputs[key.replace("_", " ")]
        if callable(value):
            made.node_tree.links.new(value(made.node_tree), socket)
        else:
            socket.default_value = value
    return made


def checker(a, b, scale):
    def node(tree):
        texture = tree.nodes.new("ShaderNodeTexChecker")
        texture.inputs["Color1"].default_value, texture.inputs["Color2"].default_value = (*a, 1), (*b, 1)
        texture.inputs["Scale"].default_value = scale
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], texture.inputs["Vector"])
        return texture.outputs["Color"]

    return node


def bricks(scale):
    def node(tree):
        texture = tree.nodes.new("ShaderNodeTexBrick")
        texture.inputs["Color1"].default_value, texture.inputs["Color2"].default_value = (0.6, 0.25, 0.15, 1), (0.45, 0.2, 0.12, 1)
        texture.inputs["Mortar"].default_value, texture.inputs["Scale"].default_value = (0.7, 0.7, 0.65, 1), scale
        upright = tree.nodes.new("ShaderNodeMapping")
        upright.inputs["Rotation"].default_value = (math.pi / 2, 0, 0)
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], upright.inputs["Vector"])
        tree.links.new(upright.outputs["Vector"], texture.inputs["Vector"])
        return texture.outputs["Color"]

    return node


def put(made, coat):
    made.data.materials.append(coat)
    return made


def box(centre, sides, coat, turn=0.0):
    bpy.ops.mesh.primitive_cube_add(size=1, location=centre, rotation=(0, 0, turn))
    bpy.context.object.scale = sides
    return put(bpy.context.object, coat)


def ball(centre, radius, coat):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=radius, location=centre)
    bpy.ops.object.shade_smooth()
    return put(bpy.context.object, coat)


def lamp(place, target, sides, watts, colour=(1, 0.95, 0.85)):
    data = bpy.data.lights.new("lamp", "AREA")
    data.shape, data.size, data.size_y, data.energy, data.color = "RECTANGLE", *sides, watts, colour
    made = bpy.data.objects.new("lamp", data)
    made.location, made.rotation_euler = place, (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(made)


def camera(place, target, lens=None):
    data = bpy.data.cameras.new("camera")
    data.angle = math.radians(50)
    made = bpy.data.objects.new("camera", data)
    made.location, made.rotation_euler = place, (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(made)
    bpy.context.scene.camera = made
    if lens:
        data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_distance = True, lens, math.dist(place, target)


def sky(colour, strength=1.0):
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (*colour, 1), strength
    bpy.context.scene.world = world


def coats():
    return {
        "white": material("white", Base_Color=(0.75, 0.75, 0.72, 1), Roughness=0.9),
        "red": material("red", Base_Color=(0.65, 0.15, 0.1, 1), Roughness=0.9),
        "green": material("green", Base_Color=(0.2, 0.5, 0.2, 1), Roughness=0.9),
        "bricks": material("bricks", Base_Color=bricks(6.0), Roughness=0.8),
        "tiles": material("tiles", Base_Color=checker((0.7, 0.65, 0.6), (0.25, 0.2, 0.2), 10), Roughness=0.35),
        "paving": material("paving", Base_Color=checker((0.7, 0.65, 0.6), (0.25, 0.2, 0.2), 40), Roughness=0.35),
        "glass": material("glass", Transmission_Weight=1.0, Roughness=0.0, IOR=1.5),
        "frosted": material("frosted", Transmission_Weight=1.0, Roughness=0.3, IOR=1.45),
        "copper": material("copper", Base_Color=(0.9, 0.5, 0.35, 1), Metallic=1.0, Roughness=0.2),
        "chrome": material("chrome", Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1.0, Roughness=0.0),
        "lacquer": material("lacquer", Base_Color=(0.1, 0.2, 0.6, 1), Roughness=0.15),
    }


def room(coat):
    box((0, 0, -0.05), (6, 6, 0.1), coat["tiles"])
    box((0, 3.05, 2), (6, 0.1, 4), coat["bricks"])
    box((-3.05, 0, 2), (0.1, 6, 4), coat["red"])
    box((3.05, 0, 2), (0.1, 6, 4), coat["green"])
    box((0, 0, 4.05), (6, 6, 0.1), coat["white"])
    camera((0, -6.5, 1.9), (0, 0, 1.5))


def still_life(coat):
    ball((-1.1, 0.2, 0.8), 0.8, coat["glass"])
    ball((1.2, 0.8, 0.7), 0.7, coat["copper"])
    box((0.3, -0.9, 0.35), (0.7, 0.7, 0.7), coat["lacquer"], 0.5)
    box((-2.0, 1.6, 1.0), (0.9, 0.9, 2.0), coat["white"], -0.3)
    ball((2.1, -0.8, 0.4), 0.4, coat["frosted"])


def lamp_scene(coat):
    room(coat)
    still_life(coat)
    lamp((0, 0, 3.98), (0, 0, 0), (1.2, 1.2), 250)


def slit_scene(coat):
    room(coat)
    still_life(coat)
    lamp((-2.8, 0.5, 3.9), (2, 0.5, 0), (0.08, 3.0), 500)


def indirect_scene(coat):
    room(coat)
    ball((1.0, 0.4, 0.9), 0.9, coat["chrome"])
    box((-1.2, 0.3, 0.6), (1.2, 1.2, 1.2), coat["bricks"], 0.4)
    box((0, 1.5, 2.9), (1.6, 1.6, 0.1), coat["white"])
    lamp((0, 1.5, 3.0), (0, 1.5, 4), (1.0, 1.0), 120)


def terrace_scene(coat):
    box((0, 0, -0.05), (30, 30, 0.1), coat["paving"])
    still_life(coat)
    box((0, 3.2, 1.5), (7, 0.2, 3), coat["bricks"])
    sky((0.45, 0.65, 1.0), 0.7)
    lamp((6, -5, 9), (0, 0, 0), (1.0, 1.0), 1200)
    camera((-1.5, -6.5, 2.4), (0, 0, 0.8))


def lens_scene(coat):
    box((0, 0, -0.05), (30, 30, 0.1), coat["paving"])
    kinds = ["lacquer", "copper", "bricks", "frosted", "white", "green"]
    for i, kind in enumerate(kinds):
        if i % 2:
            box((-2.2 + 0.95 * i, -2.0 + 1.3 * i, 0.4), (0.7, 0.7, 0.8), coat[kind], 0.4 * i)
        else:
            ball((-2.2 + 0.95 * i, -2.0 + 1.3 * i, 0.5), 0.5, coat[kind])
    sky((0.8, 0.85, 0.9), 0.5)
    lamp((-4, -4, 6), (0, 0, 0), (1.5, 1.5), 350)
    camera((0, -6.0, 1.9), (-0.4, 0.5, 0.4), 0.25)


SCENES = {"lamp": lamp_scene, "slit": slit_scene, "indirect": indirect_scene, "terrace": terrace_scene, "lens": lens_scene}


@contextmanager
def quiet():
    """Leaves out what Blender prints."""
    kept, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(null)


def load(name):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = "CPU", False, False
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    layer = scene.view_layers[0]
    layer.use_pass_normal = layer.use_pass_position = layer.use_pass_z = layer.use_pass_diffuse_color = True
    layer.cycles.denoising_store_passes = layer.cycles.pass_debug_sample_count = True
    SCENES[name](coats())


def render(path, spp, seed):
    if os.path.exists(path):
        return
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed, scene.render.filepath = spp, seed, path
    with quiet():
        bpy.ops.render.render(write_still=True)


def main(dapple, folder, seeds):
    folder = os.path.abspath(folder)
    os.makedirs(folder, exist_ok=True)
    ours = lambda *arguments: subprocess.run([dapple, "denoise", *arguments], check=True, capture_output=True)
    first_hits = [word for kind in ("normal=Normal", "albedo=DiffCol", "depth=Depth") for word in ("--layer", "{}=ViewLayer.{}".format(*kind.split("=")))]
    print("scene,seed,noisy,dapple_halves,dapple_first_hits,oidn")
    for name in SCENES:
        load(name)
        render(f"{folder}/{name}-reference.exr", REFERENCE, 1000)
        truth = channels(f"{folder}/{name}-reference.exr", "ViewLayer.Combined")
        for seed in range(seeds):
            halves = [f"{folder}/{name}-{seed}-{half}.exr" for half in "ab"]
            for half, path in enumerate(halves):
                render(path, 8, 2 * seed + half)
            out = [f"{folder}/{name}-{seed}-{kind}.exr" for kind in ("denoised", "first")]
            ours(*halves, "-o", out[0])
            ours(*halves, *first_hits, "-o", out[1])
            mean = lambda layer, letters: sum(channels(path, "ViewLayer." + layer, letters) for path in halves) / 2
            noisy = mean("Combined", "RGB")
            guided = oidn(noisy, mean("Denoising Albedo", "RGB"), mean("Denoising Normal", "XYZ"))
            images = [noisy, *(channels(path, "ViewLayer.Combined") for path in out), guided]
            print(",".join([name, str(seed), *(f"{error(image, truth):.3f}" for image in images)]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "target/results/cycles", int(sys.argv[3]) if len(sys.argv) > 3 else 8)
