"""Prepare one instant for the device: compose every matrix in float64, relative to the camera, and round it once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import InternalError
from cltaa.frame import Effect, Matrix
from cltaa_capture.cameras import camera_at, clip_to_world_direction, jitter_ndc, reversed_projection
from cltaa_capture.shadows import casting_sun, shadow_uniforms, world_to_shadow
from cltaa_capture.upload import Drawable
from cltaa_datasets.scene import AlphaMode, Instant, Orthographic, Part, Scene, Shadow, Shape, Sky, Sun

NO_SKY = Sky(zenith=(0.0, 0.0, 0.0), horizon=(0.0, 0.0, 0.0), ground=(0.0, 0.0, 0.0), ambient=0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """A drawable at one instant."""

    drawable: Drawable
    depth: float  # depth of its centre, which sets the order of drawing
    moves: bool
    mirrored: bool
    uniforms: dict[str, Any]
    vertices: NDArray[np.float32] | None = None  # [V, 9] of a deforming part: position, normal, step to previous


@dataclass(frozen=True, eq=False, slots=True)
class Staged:
    """An instant that can be drawn repeatedly, each time with its own jitter."""

    solid: list[Placed]  # near to far, so that hidden fragments are not shaded
    glassy: list[Placed]  # far to near
    has_sky: bool
    defines: dict[str, int]
    uniforms: dict[str, Any]
    shadow: Shadow | None  # the map to draw first


def float32(values: Any) -> NDArray[np.float32]:
    """Round a vector or matrix to float32."""
    return np.ascontiguousarray(values, np.float32)


def stage(scene: Scene, drawables: Sequence[Drawable], now: Instant, before: Instant, size: tuple[int, int]) -> Staged:
    """Prepare ``now`` for a picture of ``size`` (width, height) pixels; motion leads to ``before``.

    Raises InternalError for a moving part in a scene that declares no motion.
    """
    placed = _place(scene, drawables, now, before, size[0] / size[1])
    solid = [item for item in placed if item.drawable.part.material.alpha_mode is not AlphaMode.BLEND]
    glassy = [item for item in placed if item.drawable.part.material.alpha_mode is AlphaMode.BLEND]
    suns = sum(isinstance(light, Sun) for light in now.lights)
    defines = {"SUNS": suns, "LAMPS": len(now.lights) - suns}
    if now.sky is not None and now.sky.fog > 0.0:
        defines["FOG"] = 1
    if isinstance(now.lens, Orthographic):
        defines["PARALLEL"] = 1
    shadowed = casting_sun(now.lights)
    if shadowed is not None:
        defines["SHADOWED_SUN"] = shadowed[0]
    return Staged(
        solid=sorted(solid, key=lambda item: item.depth),
        glassy=sorted(glassy, key=lambda item: -item.depth),
        has_sky=now.sky is not None and Effect.SKY in scene.effects,
        defines=defines,
        uniforms=_frame_uniforms(now, size) | shadow_uniforms(now),
        shadow=None if shadowed is None else shadowed[2],
    )


def _place(scene: Scene, drawables: Sequence[Drawable], now: Instant, before: Instant, aspect: float) -> list[Placed]:
    projection, earlier_projection = (reversed_projection(instant.lens, aspect) for instant in (now, before))
    shadowed = casting_sun(now.lights)
    to_shadow = None if shadowed is None else world_to_shadow(*shadowed[1:])
    placed = []
    for drawable, pose, earlier in zip(drawables, now.poses, before.poses, strict=True):
        if pose is None:
            continue
        model_to_view = now.world_to_view @ pose
        model_to_clip = projection @ model_to_view
        uniforms = {
            "model_to_clip": float32(model_to_clip),
            "model_to_view": float32(model_to_view),
            "normal_to_world": float32(normal_matrix(pose)),
        }
        if to_shadow is not None:
            uniforms["model_to_shadow"] = float32(to_shadow @ pose)
        # Translucent parts write no motion, so they may move undeclared; the channel reactive covers them.
        solid = drawable.part.material.alpha_mode is not AlphaMode.BLEND
        shapes = _shapes(drawable.part, now, before)
        changes = shapes is not None and shapes[0] is not shapes[1]
        moves = solid and earlier is not None and (changes or not np.array_equal(pose, earlier))
        if earlier is not None and moves:
            if Effect.MOTION not in scene.effects:
                raise InternalError(f"scene {scene.name} declares no motion, but {drawable.part.name} moves")
            earlier_clip = earlier_projection @ (before.world_to_view @ earlier)
            uniforms["clip_displacement"] = float32(earlier_clip - model_to_clip)
            uniforms["previous_model_to_clip"] = float32(earlier_clip)
        centre = drawable.centre if shapes is None else np.append(shapes[0].positions.mean(axis=0), 1.0)
        depth = float(-(model_to_view @ centre)[2])
        mirrored = bool(np.linalg.det(pose[:3, :3]) < 0.0)
        vertices = None if shapes is None else vertex_data(*shapes)
        placed.append(Placed(drawable, depth, moves, mirrored, uniforms, vertices))
    return placed


def _shapes(part: Part, now: Instant, before: Instant) -> tuple[Shape, Shape] | None:
    """Return the shapes of a deforming part, now and before; a part absent before uses its present shape."""
    if not part.deforms:
        return None
    if part.name not in now.shapes:
        raise InternalError(f"part {part.name} deforms, but an instant does not say how it stands")
    shape = now.shapes[part.name]
    return shape, before.shapes.get(part.name, shape)


def vertex_data(now: Shape, before: Shape) -> NDArray[np.float32]:
    """Return the vertex data of a deformed part: position, normal, and the step to the previous position.

    The step is the difference of positions rounded to float32, as they are drawn, so that a still vertex has a step of
    exactly 0.
    """
    position, previous = float32(now.positions), float32(before.positions)
    step = previous.astype(np.float64) - position
    return float32(np.concatenate([position, now.normals, step], axis=1))


def _frame_uniforms(now: Instant, size: tuple[int, int]) -> dict[str, Any]:
    sky = now.sky or NO_SKY
    uniforms = {
        "half_size": float32(size) / np.float32(2.0),
        "exposure": now.exposure,
        "view_to_world": float32(now.world_to_view[:3, :3].T),
        "ndc_to_world": float32(clip_to_world_direction(camera_at(now, size[0] / size[1]))),
        "sky.ambient": sky.ambient,
        "sky.fog": sky.fog,
        "stars": sky.stars,
    }
    for name in ("zenith", "horizon", "ground", "glow", "glow_direction"):
        uniforms[f"sky.{name}"] = float32(getattr(sky, name))
    suns = lamps = 0
    for light in now.lights:
        if isinstance(light, Sun):
            uniforms[f"suns[{suns}].direction"] = float32(light.direction)
            uniforms[f"suns[{suns}].irradiance"] = float32(light.irradiance)
            suns += 1
        else:
            position = now.world_to_view @ np.append(light.position, 1.0)
            uniforms[f"lamps[{lamps}].view_position"] = float32(position[:3])
            uniforms[f"lamps[{lamps}].intensity"] = float32(light.intensity)
            lamps += 1
    return uniforms


def jitter_uniforms(jitter_px: tuple[float, float], size: tuple[int, int]) -> dict[str, Any]:
    """Return the shift of the picture, and of the sample in it, in NDC."""
    shift = float32(jitter_ndc(jitter_px, *size))
    return {"jitter_ndc": shift, "sample_shift": -shift}


def normal_matrix(pose: Matrix) -> Matrix:
    """Return the inverse transpose of a pose's upper 3x3, up to a positive factor, by cofactors, which always exist."""
    a, b, c = pose[:3, :3]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    # Divided by a power of two, which keeps the digits: a shader squares a normal, which float32 must hold.
    size = np.frexp(np.abs(cofactors).max())[1]
    return np.asarray(np.ldexp(cofactors, -size) * np.copysign(1.0, np.linalg.det(pose[:3, :3])))
