"""Render a small Blender sequence and its cameras: ``python render_blender.py FOLDER FRAMES WIDTH HEIGHT SAMPLES``.

Runs in an environment of its own that has bpy. With SAMPLES 1 each pixel is one sample at its centre, jittered by lens
shift; with more it is the truth, over the box of the pixel, without jitter and without vectors.
"""

from __future__ import annotations

import json
import math
import random
import sys
from pathlib import Path
from typing import Any

import bpy

PERIOD = 8
ORDERS = (0, 4, 2, 6, 1, 5, 3, 7), (0, 3, 6, 1, 4, 7, 2, 5)


def jitter(frame: int) -> tuple[float, float]:
    """A centred pattern of PERIOD, in pixels, x right, y down."""
    x, y = ((order[frame % PERIOD] + 0.5) / PERIOD - 0.5 for order in ORDERS)
    return x, y


def glowing(name: str, scale: float, dark: tuple[float, ...], light: tuple[float, ...]) -> Any:
    """A material that emits checks: one sample of it has no noise."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output, emission = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeEmission")
    checks, place = nodes.new("ShaderNodeTexChecker"), nodes.new("ShaderNodeTexCoord")
    checks.inputs["Scale"].default_value = scale
    checks.inputs["Color1"].default_value, checks.inputs["Color2"].default_value = (*dark, 1), (*light, 1)
    links.new(place.outputs["Object"], checks.inputs["Vector"])
    links.new(checks.outputs["Color"], emission.inputs["Color"])
    links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material


def box(name: str, at: tuple[float, ...], size: tuple[float, ...], turn: tuple[float, ...], material: Any) -> Any:
    """A cube."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=at, rotation=turn)
    made = bpy.context.object
    made.name, made.scale = name, size
    made.data.materials.append(material)
    return made


def build() -> tuple[Any, Any]:
    """A floor, a wall, boxes, and one box that will move: the moving box and the camera."""
    random.seed(1)
    box("floor", (0, 0, -1.05), (30, 30, 0.1), (0, 0, 0), glowing("floor", 9, (0.05, 0.04, 0.03), (0.5, 0.5, 0.45)))
    box("wall", (0, 6, 1), (30, 0.1, 8), (0, 0.2, 0), glowing("wall", 13, (0.1, 0.2, 0.4), (0.7, 0.6, 0.3)))
    for place in range(6):
        at = (random.uniform(-3, 3), random.uniform(0, 4), random.uniform(-0.5, 1))
        turn = (random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, 1))
        shade = glowing(f"box{place}", 3, (0.05, 0.02 + 0.1 * place, 0.1), (0.8, 0.9 - 0.1 * place, 0.3))
        box(f"box{place}", at, (0.8, 0.8, 0.8), turn, shade)
    mover = box("mover", (0, -1, 0), (1, 0.5, 1), (0, 0, 0), glowing("mover", 4, (0.02, 0.02, 0.02), (1.5, 0.4, 0.2)))
    lens = bpy.data.cameras.new("camera")
    camera = bpy.data.objects.new("camera", lens)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    lens.angle, lens.clip_start, lens.clip_end = math.radians(50), 0.1, 200
    return mover, camera


def animate(mover: Any, camera: Any, frames: int, width: int, jittered: bool) -> None:
    """Key every frame: the box turns and flies, the camera slides and turns, the lens shifts by the jitter."""
    for frame in range(frames + 3):
        time = (frame - 1) / 12
        mover.location = (-1.2 + 1.5 * time, -1, 0.3 * math.sin(3 * time))
        mover.rotation_euler = (0.3 + time, 0.2, 0.1 + 0.5 * time)
        camera.location = (0.9 * time, -6, 1.2 + 0.2 * time)
        camera.rotation_euler = (math.radians(80), 0, math.radians(4 * time))
        for thing in (mover, camera):
            thing.keyframe_insert("location", frame=frame)
            thing.keyframe_insert("rotation_euler", frame=frame)
        # Both shifts are fractions of the larger side, y up.
        x, y = jitter(frame) if jittered else (0.0, 0.0)
        camera.data.shift_x, camera.data.shift_y = x / width, -y / width
        camera.data.keyframe_insert("shift_x", frame=frame)
        camera.data.keyframe_insert("shift_y", frame=frame)


def settings(width: int, height: int, samples: int) -> None:
    """Cycles on the CPU, point samples or truth, one multi-layer EXR a frame."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", samples
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0 if samples > 1 else 0.01
    scene.cycles.max_bounces = 0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    layer = scene.view_layers[0]
    layer.use_pass_z, layer.use_pass_vector = True, samples == 1
    image = scene.render.image_settings
    image.media_type, image.file_format = "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER"
    image.color_depth, image.exr_codec = "32", "ZIP"
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.2, 0.3, 0.5, 1)


def main(folder: Path, frames: int, width: int, height: int, samples: int) -> None:
    """Write the frames and camera.json."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mover, camera = build()
    settings(width, height, samples)
    animate(mover, camera, frames, width, jittered=samples == 1)
    across = 1 / math.tan(camera.data.angle / 2)
    projection = [[across, 0, 0, 0], [0, across * width / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]
    side = {}
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        bpy.context.scene.cycles.seed = frame
        bpy.context.scene.render.filepath = str(folder / f"shot.{frame:04d}.exr")
        bpy.ops.render.render(write_still=True)
        view = [list(row) for row in camera.matrix_world.inverted()]
        side[frame] = {"world_to_view": view, "view_to_clip": projection, "jitter_px": jitter(frame)}
    (folder / "camera.json").write_text(json.dumps({"frames": side}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:6]))
