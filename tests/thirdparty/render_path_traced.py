"""Path-trace with Cycles: ``python render_path_traced.py FOLDER FIRST LAST SIZE SAMPLES [KIND]``, SIZE as in 192x108.

Runs in an environment of its own that has bpy. KIND: ``random``, the samples anywhere in their pixel, as Cycles draws
them; ``jittered``, all at one place in it, by lens shift; ``film``, random on a transparent film. A room that a lamp
lights, under a camera that moves: glass, gloss, leaves cut out by alpha, a body that turns and one that deforms.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import bpy
from render_blender import box, jitter, settings  # type: ignore[import-not-found]  # beside this file


def surface(name: str, colour: tuple[float, ...], **inputs: float) -> Any:
    """A principled material, and what it has beside its colour, such as Roughness and Metallic."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return material


def checked(material: Any, socket: str, scale: float, one: float, other: float) -> Any:
    """The same material, of which one input is a checker of two values."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    checks, place = nodes.new("ShaderNodeTexChecker"), nodes.new("ShaderNodeTexCoord")
    checks.inputs["Scale"].default_value = scale
    checks.inputs["Color1"].default_value, checks.inputs["Color2"].default_value = (
        (one,) * 3 + (1,),
        (other,) * 3 + (1,),
    )
    links.new(place.outputs["Object"], checks.inputs["Vector"])
    links.new(checks.outputs["Color"], nodes["Principled BSDF"].inputs[socket])
    return material


def ball(at: tuple[float, ...], size: float, material: Any) -> Any:
    """A smooth ball."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=size, location=at, segments=48, ring_count=24)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def build(film: bool) -> tuple[Any, Any, Any]:
    """The room, without its wall on a transparent film: the body that turns, the shape that one takes, the camera."""
    box("floor", (0, 0, -1), (14, 14, 0.1), (0, 0, 0), checked(surface("floor", (1,) * 3), "Base Color", 9, 0.5, 0.15))
    if not film:
        box("wall", (0, 3.5, 1), (14, 0.1, 6), (0, 0, 0), surface("wall", (0.6, 0.35, 0.25)))
    ball((1.5, -0.6, -0.25), 0.7, surface("glass", (1, 1, 1), Transmission_Weight=1.0, Roughness=0.0))
    ball((-2.2, 0.8, -0.2), 0.75, surface("chrome", (0.9, 0.8, 0.6), Metallic=1.0, Roughness=0.25))
    leaves = checked(surface("leaves", (0.1, 0.5, 0.1)), "Alpha", 6, 1, 0)
    bpy.ops.mesh.primitive_plane_add(size=2.4, location=(0.3, 1.8, 0.3), rotation=(math.radians(90), 0, 0.3))
    bpy.context.object.data.materials.append(leaves)
    turning = box("turning", (0, -0.4, 0), (0.9, 0.9, 0.9), (0, 0, 0), surface("red", (0.7, 0.1, 0.08), Roughness=0.4))
    soft = ball((-1.2, -1.5, -0.5), 0.4, surface("soft", (0.15, 0.3, 0.7)))
    soft.shape_key_add(name="rest")
    squeezed = soft.shape_key_add(name="squeezed")
    for vertex in squeezed.data:
        x, y, z = vertex.co
        vertex.co = x * 1.5, y * 1.2, z * 0.5 + 0.1 * math.sin(9 * x)
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.energy, lamp.size = 160, 0.6
    hung = bpy.data.objects.new("lamp", lamp)
    hung.location, hung.rotation_euler = (1.2, -2, 3), (math.radians(25), math.radians(15), 0)
    lens = bpy.data.cameras.new("camera")
    camera = bpy.data.objects.new("camera", lens)
    for thing in (hung, camera):
        bpy.context.scene.collection.objects.link(thing)
    bpy.context.scene.camera = camera
    lens.angle, lens.clip_start, lens.clip_end = math.radians(50), 0.1, 200
    return turning, squeezed, camera


def animate(turning: Any, squeezed: Any, camera: Any, last: int, width: int, jittered: bool) -> None:
    """Key every frame."""
    for frame in range(last + 3):
        time = (frame - 1) / 12
        turning.rotation_euler = (0.3 + time, 0.2, 0.8 * time)
        squeezed.value = 0.5 - 0.5 * math.cos(3 * time)
        camera.location, camera.rotation_euler = (
            (-0.4 + 0.5 * time, -5, 0.7),
            (math.radians(84), 0, math.radians(3 * time)),
        )
        x, y = jitter(frame) if jittered else (0.0, 0.0)
        camera.data.shift_x, camera.data.shift_y = x / width, -y / width  # fractions of the larger side, y up
        turning.keyframe_insert("rotation_euler", frame=frame)
        squeezed.keyframe_insert("value", frame=frame)
        for path in ("location", "rotation_euler"):
            camera.keyframe_insert(path, frame=frame)
        for path in ("shift_x", "shift_y"):
            camera.data.keyframe_insert(path, frame=frame)


def main(folder: Path, first: int, last: int, size: str, samples: int, kind: str = "random") -> None:
    """Write the frames and camera.json."""
    width, height = map(int, size.split("x"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    turning, squeezed, camera = build(kind == "film")
    settings(width, height, samples)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scene.cycles.max_bounces, scene.render.film_transparent = 8, kind == "film"
    scene.cycles.filter_width = 0.01 if kind == "jittered" else 1.0
    scene.world.node_tree.nodes["Background"].inputs[1].default_value = 0.3
    layer.use_pass_vector, layer.cycles.denoising_store_passes = True, True
    animate(turning, squeezed, camera, last, width, kind == "jittered")
    across = 1 / math.tan(camera.data.angle / 2)
    projection = [[across, 0, 0, 0], [0, across * width / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]
    side = {}
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        scene.cycles.seed, scene.render.filepath = frame + samples, str(folder / f"shot.{frame:04d}.exr")
        bpy.ops.render.render(write_still=True)
        placed = jitter(frame) if kind == "jittered" else (0.0, 0.0)
        view = [list(row) for row in camera.matrix_world.inverted()]
        side[frame] = {"world_to_view": view, "view_to_clip": projection, "jitter_px": placed}
    (folder / "camera.json").write_text(json.dumps({"frames": side}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], int(sys.argv[5]), *sys.argv[6:7])
