"""``cltaa raycast``: ray-cast sequences that declare nothing and share no code with the rasteriser.

Rays in float64 hit spheres and planes with solid textures, so depth and motion are exact. They test a resolve that was
tuned on rasterised scenes as another tool's frames would.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from cltaa.commands.options import COUNT_OR_0, FILE_PATH, SIZE, json_option
from cltaa.errors import UsageError
from cltaa.frame import Camera, Frame
from cltaa.io.atomic import make_folder, owned, remove_stale_temporaries, temporary_folder
from cltaa.io.exr_write import write_frame, write_image
from cltaa.printable import json_of
from cltaa.progress import shown_progress

Array = NDArray[np.float64]
Pose = tuple[Array, Array]  # rotation [3, 3] and position [3] of a body, object to world
Texture = Callable[[Array, float], Array]  # (points on the body [N, 3], time) -> colours [N, 3]

UP = np.array([0.0, 1.0, 0.0])
FIELD = 0.55  # tangent of half the vertical field of view
NEAR, FAR = 0.1, 1000.0


def turn(axis: tuple[float, float, float], angle: float) -> Array:
    """Return the rotation [3, 3] about ``axis`` by ``angle`` radians (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def placed(x: float, y: float, z: float, rotation: Array | None = None) -> Pose:
    """Return a pose at that position."""
    return (np.eye(3) if rotation is None else rotation), np.array([x, y, z])


def stands(x: float, y: float, z: float) -> Callable[[float], Pose]:
    """Return the constant pose of a still body."""
    return lambda _t: placed(x, y, z)


@dataclass(frozen=True)
class Body:
    """A sphere of ``radius``, or for radius 0 the plane z = 0 of its own space, ``extent`` to each side."""

    pose: Callable[[float], Pose]
    texture: Texture
    radius: float = 0.0
    extent: tuple[float, float] = (np.inf, np.inf)
    emits: bool = False  # the texture is emitted light
    sheen: float = 0.0  # strength of a highlight


@dataclass(frozen=True)
class Lamp:
    """A light at a position, or with ``sun`` at infinity in that direction."""

    at: Callable[[float], Array]
    colour: tuple[float, float, float]
    sun: bool = True


@dataclass(frozen=True)
class Family:
    """A scene as formulas of time, in frames."""

    bodies: list[Body]
    lamps: list[Lamp]
    eye: Callable[[float], Pose] = field(default=lambda _t: placed(0.0, 1.5, 5.0, turn((1, 0, 0), -0.15)))
    ambient: float = 0.35
    fog: Callable[[float], float] = field(default=lambda _t: 0.0)
    grain: float = 0.0  # standard deviation of film grain relative to a sample's colour
    skylight: int = 0  # random rays per sample that estimate the ambient light; 0: uniform light


def checks(scale: float, one: tuple[float, float, float], other: tuple[float, float, float]) -> Texture:
    """Return solid checks, with a finer ripple on both colours."""

    def texture(p: Array, _t: float) -> Array:
        odd = np.floor(p * scale + 1e-6).sum(-1) % 2
        ripple = 1 + 0.25 * np.sin(9.1 * scale * p[:, 0] + 2) * np.sin(7.3 * scale * (p[:, 1] + p[:, 2]))
        return np.where(odd[:, None] > 0, np.array(one), np.array(other)) * ripple[:, None]

    return texture


def stripes(scale: float, speed: float = 0.0) -> Texture:
    """Return text-like stripes of several periods that scroll by ``speed`` units a frame along x."""

    def texture(p: Array, t: float) -> Array:
        x, y = p[:, 0] + speed * t, p[:, 1]
        marks = np.sin(scale * x) * np.sin(0.37 * scale * x + 1) + 0.4 * np.sin(scale * y + np.floor(x))
        value = 0.5 + 0.45 * np.tanh(3 * marks)
        return np.stack([value, 0.9 * value, 0.3 + 0.5 * (1 - value)], -1)

    return texture


FLOOR_CHECKS = checks(1.3, (0.75, 0.7, 0.6), (0.22, 0.24, 0.3))
FLOOR = Body(lambda _t: placed(0, 0, 0, turn((1, 0, 0), -np.pi / 2)), FLOOR_CHECKS)
WALL = Body(stands(0, 0, -6), checks(0.9, (0.6, 0.35, 0.3), (0.3, 0.45, 0.5)))
SUN = Lamp(lambda _t: np.array([0.5, 0.8, 0.45]), (0.9, 0.85, 0.75))


def _ball(pose: Callable[[float], Pose], radius: float, seed: int, sheen: float = 0.0) -> Body:
    hue = np.random.default_rng(seed).uniform(0.15, 0.95, (2, 3)).tolist()
    return Body(pose, checks(3.0 / radius, tuple(hue[0]), tuple(hue[1])), radius, sheen=sheen)


def _rolling(seed: int) -> Family:
    """Textured balls roll and slide over a floor in the sun."""

    def rolls(x: float, z: float, speed: float, radius: float) -> Callable[[float], Pose]:
        return lambda t: placed(x + speed * t, radius, z, turn((0, 0, 1), -speed * t / radius))

    def slides(t: float) -> Pose:
        return placed(2.0 - 0.06 * t, 0.5, 1.6)

    balls = [
        _ball(rolls(-2.5, 0.3, 0.05, 0.8), 0.8, seed),
        _ball(rolls(2.8, -1.8, -0.035, 1.1), 1.1, seed + 1),
        _ball(slides, 0.5, seed + 2),
    ]
    return Family([FLOOR, WALL, *balls], [SUN])


def _lights(seed: int) -> Family:
    """Three lamps of different colours circle over still balls."""
    phase = np.random.default_rng(seed).uniform(0, 6.28, 3)

    def lamp(k: int, colour: tuple[float, float, float]) -> Lamp:
        def at(t: float) -> Array:
            a = phase[k] + (0.07 + 0.03 * k) * t
            return np.array([2.5 * np.sin(a), 1.8 + np.sin(1.3 * a), 2.0 * np.cos(a) - 1.5])

        return Lamp(at, colour, sun=False)

    balls = [_ball(stands(x, 0.7, -1.0), 0.7, seed + k, 0.6) for k, x in enumerate((-2.0, 0.0, 2.0))]
    lamps = [lamp(0, (2.4, 1.2, 0.8)), lamp(1, (0.6, 1.8, 2.2)), lamp(2, (1.6, 0.5, 1.9))]
    return Family([FLOOR, WALL, *balls], lamps, ambient=0.1)


def _fog(seed: int) -> Family:
    """A camera walks into fog that thickens and clears."""
    phase = np.random.default_rng(seed).uniform(0, 6.28)
    balls = [_ball(stands(x, 0.8, -2 * abs(x)), 0.8, seed + k) for k, x in enumerate((-1.8, 0.2, 2.1))]
    return Family(
        [FLOOR, WALL, *balls],
        [SUN],
        eye=lambda t: placed(0.2 * np.sin(0.1 * t), 1.5, 5.0 - 0.04 * t, turn((1, 0, 0), -0.15)),
        fog=lambda t: 0.12 + 0.08 * np.sin(0.12 * t + phase),
    )


def _grain(seed: int) -> Family:
    """A slow pan with film grain."""
    still = _rolling(seed)
    return Family(
        [FLOOR, WALL, *[_ball(stands(x, 0.8, 0.0), 0.8, seed + k) for k, x in enumerate((-1.5, 1.2))]],
        still.lamps,
        eye=lambda t: placed(0.0, 1.5, 5.0, turn((0, 1, 0), 0.004 * t) @ turn((1, 0, 0), -0.15)),
        grain=0.08,
    )


def _shake(seed: int) -> Family:
    """A hand-held camera shakes before rolling balls."""
    by = np.random.default_rng(seed).normal(0, 0.012, (4096, 3))

    def eye(t: float) -> Pose:
        x, y, z = by[int(t) % len(by)]
        return placed(3 * x, 1.5 + 3 * y, 5.0, turn((0, 1, 0), x) @ turn((1, 0, 0), y - 0.15) @ turn((0, 0, 1), z))

    return Family(_rolling(seed).bodies, [SUN], eye=eye)


def _noise(seed: int) -> Family:
    """Rolling balls with four random rays of skylight a sample, as in a path tracer."""
    return Family(_rolling(seed).bodies, [Lamp(SUN.at, (0.45, 0.42, 0.37))], ambient=0.9, skylight=4)


def _shadows(seed: int) -> Family:
    """Balls fly, and their shadows move over floor and wall."""

    def flies(k: int) -> Callable[[float], Pose]:
        return lambda t: placed(3.0 * np.sin(0.09 * t + 2 * k), 2.6 + 0.4 * k, -1.0 + 1.2 * np.cos(0.07 * t + k))

    balls = [_ball(flies(k), 0.55, seed + k) for k in range(3)]
    return Family([FLOOR, WALL, *balls], [SUN])


def _screen(seed: int) -> Family:
    """Text scrolls on two screens, without motion vectors for it."""
    at = np.random.default_rng(seed).uniform(0, 6.28)
    pixel = 2 * FIELD * 5.0 / 90  # one pixel of 90 rows at the screen's distance
    first = Body(stands(-1.3, 1.6, 0.0), stripes(9.0, pixel), extent=(1.1, 0.8), emits=True)
    second = Body(stands(1.4, 1.6, 0.0), stripes(5.0 + 0.1 * at, -0.6 * pixel), extent=(1.0, 0.8), emits=True)
    return Family([FLOOR, WALL, first, second], [SUN])


def _water(seed: int) -> Family:
    """Waves glitter around a ball, without motion vectors for them."""
    phase = np.random.default_rng(seed).uniform(0, 6.28, 4)

    def surface(p: Array, t: float) -> Array:
        bend = sum(
            np.sin(a * p[:, 0] + b * p[:, 1] + c * t + d)
            for a, b, c, d in zip((3, -2, 5, 1), (2, 4, -3, 6), (0.3, 0.2, 0.4, 0.25), phase, strict=True)
        )
        shine = 0.25 + 0.2 * np.tanh(1.5 * bend) + 2.0 * np.exp(-8 * (bend - 2.2) ** 2)
        return np.asarray(shine[:, None] * np.array([0.55, 0.8, 1.0]))

    pool = Body(FLOOR.pose, surface, emits=True)
    ball = _ball(stands(0.3, 0.9, 0.5), 0.6, seed)
    return Family([pool, WALL, ball], [SUN])


def _cut(seed: int) -> Family:
    """Three cameras, cut from one to the next, undeclared."""
    views = [placed(0, 1.5, 5, turn((1, 0, 0), -0.15)), placed(3, 2.5, 3, turn((0, 1, 0), 0.7)), placed(-2, 1, 2)]
    return Family(
        [FLOOR, WALL, *[_ball(stands(x, 0.8, -1.0), 0.8, seed + k) for k, x in enumerate((-1.5, 1.2))]],
        [SUN],
        eye=lambda t: views[int(t // 12) % len(views)],
    )


def _discs(seed: int) -> Family:
    """Discs smaller than a pixel, of radiance 1, 10 and 1000."""
    rng = np.random.default_rng(seed)
    places = [
        (x + rng.uniform(-0.1, 0.1), y + rng.uniform(-0.1, 0.1)) for y in (0.6, 1.5, 2.4) for x in (-2.2, 0.0, 2.2)
    ]

    def glow(radiance: float) -> Texture:
        return lambda p, _t: np.where((p**2).sum(-1, keepdims=True) < 0.03**2, radiance, 0.02) * np.ones(3)

    discs = [
        Body(stands(x, y, 0.0), glow(10.0 ** (k % 3 + (k % 3 == 2))), extent=(0.6, 0.4), emits=True)
        for k, (x, y) in enumerate(places)
    ]
    return Family([WALL, *discs], [SUN])


FAMILIES: dict[str, Callable[[int], Family]] = {
    "cut": _cut,
    "discs": _discs,
    "fog": _fog,
    "grain": _grain,
    "lights": _lights,
    "noise": _noise,
    "rolling": _rolling,
    "screen": _screen,
    "shadows": _shadows,
    "shake": _shake,
    "water": _water,
}


@dataclass(frozen=True)
class Hit:
    """First hits of N rays."""

    depth: Array  # [N] along the view axis, infinite without a hit
    body: NDArray[np.int64]  # [N], -1 without a hit
    place: Array  # [N, 3] in the body's space
    world: Array  # [N, 3]
    normal: Array  # [N, 3]


def _reach(body: Body, pose: Pose, origin: Array, direction: Array) -> Array:
    """Return the distance from ``origin`` [3] or [N, 3] to the body in units of ``direction`` [N, 3]; infinite for a
    miss."""
    rotation, centre = pose
    o, d = (origin - centre) @ rotation, direction @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        if body.radius:
            a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - body.radius**2
            t = (-b - np.sqrt(b * b - a * c)) / a
            return np.where(t > 1e-6, t, np.inf)
        t = -o[..., 2] / d[..., 2]
        p = o + t[:, None] * d
        inside = (np.abs(p[:, 0]) <= body.extent[0]) & (np.abs(p[:, 1]) <= body.extent[1])
        return np.where((t > 1e-6) & inside, t, np.inf)


def cast(family: Family, t: float, origin: Array, direction: Array) -> Hit:
    """Return the first hits of rays at time ``t``; lengths are in units of ``direction``."""
    poses = [body.pose(t) for body in family.bodies]
    reach = np.stack([_reach(b, pose, origin, direction) for b, pose in zip(family.bodies, poses, strict=True)])
    first = reach.argmin(0)
    depth = reach[first, np.arange(len(first))]
    hit = np.isfinite(depth)
    world = origin + np.where(hit, depth, 1.0)[:, None] * direction
    place, normal = np.zeros_like(world), np.zeros_like(world)
    for k, (body, (rotation, centre)) in enumerate(zip(family.bodies, poses, strict=True)):
        of = hit & (first == k)
        place[of] = (world[of] - centre) @ rotation
        local = place[of] / body.radius if body.radius else np.broadcast_to([0.0, 0.0, 1.0], place[of].shape)
        normal[of] = local @ rotation.T
    return Hit(depth, np.where(hit, first, -1), place, world, normal)


def _shadowed(family: Family, t: float, origin: Array, way: Array, length: float) -> NDArray[np.bool_]:
    """Return whether a ball occludes the segment from ``origin`` along ``way`` times ``length``."""
    balls = [body for body in family.bodies if body.radius]
    return np.asarray(
        np.any([_reach(ball, ball.pose(t), origin, way) < length for ball in balls] or [np.zeros(len(way), bool)], 0)
    )


def shade(family: Family, t: float, hit: Hit, direction: Array, rng: np.random.Generator) -> Array:
    """Return the light [N, 3] along rays."""
    sky = 0.35 + 0.25 * np.clip(direction[:, 1:2], -1, 1) * np.array([0.4, 0.7, 1.0])
    colour = sky * np.ones(3)
    for k, body in enumerate(family.bodies):
        of = hit.body == k
        if not of.any():
            continue
        albedo = body.texture(hit.place[of], t)
        if body.emits:
            colour[of] = albedo
            continue
        world, normal = hit.world[of], hit.normal[of]
        start = world + 1e-4 * normal
        light = np.full((len(world), 1), family.ambient)
        if family.skylight:
            ways = rng.normal(size=(family.skylight, *world.shape))
            ways = ways / np.linalg.norm(ways, axis=-1, keepdims=True) + normal
            seen = [~_shadowed(family, t, start, way, np.inf) for way in ways]
            gleam = [1 + 3 * (way[:, :1] > 0.8 * np.linalg.norm(way, axis=-1, keepdims=True)) for way in ways]
            light = family.ambient * np.mean([s[:, None] * g for s, g in zip(seen, gleam, strict=True)], 0) / 1.5
        total, shine = light * np.ones(3), np.zeros((len(world), 1))
        view = -direction[of] / np.linalg.norm(direction[of], axis=-1, keepdims=True)
        for lamp in family.lamps:
            at = lamp.at(t)
            way = np.broadcast_to(at, world.shape) if lamp.sun else at - world
            away = np.linalg.norm(way, axis=-1, keepdims=True)
            cosine = np.clip((way * normal).sum(-1, keepdims=True) / away, 0, None)
            lit = ~_shadowed(family, t, start, way, np.inf if lamp.sun else 1.0)
            fall = 1.0 if lamp.sun else 1.0 / (0.2 + away**2 * 0.5)
            total = total + cosine * lit[:, None] * fall * np.array(lamp.colour)
            half = way / away + view
            half /= np.linalg.norm(half, axis=-1, keepdims=True)
            shine = shine + lit[:, None] * fall * np.clip((half * normal).sum(-1, keepdims=True), 0, 1) ** 60
        colour[of] = albedo * total + body.sheen * shine
    thick = family.fog(t)
    if thick:
        clear = np.exp(-thick * np.where(np.isfinite(hit.depth), hit.depth, 60.0))[:, None]
        colour = clear * colour + (1 - clear) * np.array([0.62, 0.66, 0.7])
    return np.asarray(colour)


def camera_of(pose: Pose, aspect: float) -> Camera:
    """Return the camera at a pose; it looks along -z."""
    rotation, eye = pose
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = rotation.T, -rotation.T @ eye
    depth = (FAR + NEAR) / (NEAR - FAR), 2 * FAR * NEAR / (NEAR - FAR)
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1], clip[2, 2], clip[2, 3], clip[3, 2] = 1 / (FIELD * aspect), 1 / FIELD, *depth, -1.0
    return Camera(view, clip)


def _ndc(size: tuple[int, int], at: Array) -> Array:
    """Convert pixel positions [N, 2], y down, to normalised device coordinates [N, 2], y up."""
    return np.asarray(at / np.array(size) * [2, -2] + [-1, 1])


def _pixels(size: tuple[int, int], at: Array) -> Array:
    return np.asarray((at + np.array([1, -1])) / [2, -2] * np.array(size))


def _directions(pose: Pose, size: tuple[int, int], at: Array) -> Array:
    ndc = _ndc(size, at)
    ways = np.stack([ndc[:, 0] * FIELD * size[0] / size[1], ndc[:, 1] * FIELD, -np.ones(len(ndc))], -1)
    return ways @ pose[0].T


def halton(index: int, period: int) -> tuple[float, float]:
    """Return sample ``index`` of Halton (2, 3), less the mean over a period, in [-0.5, 0.5)."""

    def inverse(i: int, base: int) -> float:
        value, scale = 0.0, 1.0 / base
        while i:
            i, digit = divmod(i, base)
            value, scale = value + digit * scale, scale / base
        return value

    points = np.array([[inverse(i + 1, base) for base in (2, 3)] for i in range(period)])
    # Without the mean, of less than a half, the last of a long period may lie beyond the pixel by a thousandth.
    x, y = np.clip(points - points.mean(0), -0.5, np.nextafter(0.5, 0.0))[index % period].tolist()
    return x, y


def frame_of(family: Family, index: int, size: tuple[int, int], jitter: tuple[float, float], seed: int) -> Frame:
    """Draw frame ``index``: one sample a pixel, exact planar depth, and exact motion to the previous frame."""
    width, height = size
    rng = np.random.default_rng((seed, index, 1))
    pose = family.eye(index)
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    at = np.stack([x + 0.5 + jitter[0], y + 0.5 + jitter[1]], -1)
    ways = _directions(pose, size, at)
    hit = cast(family, index, pose[1], ways)
    colour = shade(family, index, hit, ways, rng)
    if family.grain:
        colour = colour * np.exp(rng.normal(0, family.grain, (len(colour), 1)) - family.grain**2 / 2)
    camera = camera_of(pose, width / height)
    before = _before(family, index, hit, ways)
    rotation, eye = family.eye(max(index - 1, 0))
    view = (before - eye * (hit.body >= 0)[:, None]) @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        ndc = np.stack([-view[:, 0] / view[:, 2] / (FIELD * width / height), -view[:, 1] / view[:, 2] / FIELD], -1)
    motion = (_pixels(size, ndc) - at).reshape(height, width, 2).astype(np.float32)
    moved = np.abs(motion) > 1e-4
    motion = np.where(moved.any(-1, keepdims=True), motion, np.float32(0))
    return Frame(
        index=index,
        colour=colour.reshape(height, width, 3).astype(np.float32),
        depth=hit.depth.reshape(height, width).astype(np.float32),
        camera=camera,
        jitter_px=jitter,
        motion=motion,
    )


def _before(family: Family, index: int, hit: Hit, ways: Array) -> Array:
    """Return the previous world positions of the hit surfaces; directions for the sky."""
    before = ways.copy()
    for k, body in enumerate(family.bodies):
        of = hit.body == k
        rotation, centre = body.pose(max(index - 1, 0))
        before[of] = hit.place[of] @ rotation.T + centre
    return before


def truth_of(family: Family, index: int, size: tuple[int, int], samples: int, seed: int) -> Array:
    """Draw the mean [H, W, 3] of ``samples`` stratified samples a pixel, a square number."""
    width, height = size
    side = math.isqrt(samples)
    rng = np.random.default_rng((seed, index, 2))
    pose = family.eye(index)
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    total = np.zeros((width * height, 3))
    for cell in range(side * side):
        off = (np.array(divmod(cell, side)) + rng.random((width * height, 2))) / side
        ways = _directions(pose, size, np.stack([x, y], -1) + off)
        total += shade(family, index, cast(family, index, pose[1], ways), ways, rng)
    return np.asarray((total / side**2).reshape(height, width, 3))


def draw(family: str, output: Path, frames: int, size: tuple[int, int], period: int, reference: int, seed: int) -> None:
    """Write ``frames`` frames [H, W] of a family, and with ``reference`` samples their truth into ``reference/``.

    Keeps the files that an earlier call with these arguments has written. Raises UsageError for a folder with other EXR
    files, which would be taken for frames or the truth of this sequence, and for samples that fill no square grid.
    """
    if (side := math.isqrt(reference)) ** 2 != reference:
        what, expected = "--reference: samples lie on a square grid", f"{side**2} or {(side + 1) ** 2}"
        raise UsageError(what, expected=expected, found=reference)
    scene = FAMILIES[family](seed)

    def write(path: Path, index: int) -> None:
        write_frame(path, frame_of(scene, index, size, halton(index, period), seed))

    def write_truth(path: Path, index: int) -> None:
        truth = truth_of(scene, index, size, reference, seed).astype(np.float32)
        channels = {channel: truth[..., place] for place, channel in enumerate("RGB")}
        write_image(path, channels, {"cltaa:frame": index, "cltaa:samples": reference})

    drawing = {output: write} | ({output / "reference": write_truth} if reference else {})
    with owned(output), shown_progress(family) as progress:
        for folder in filter(Path.is_dir, (output, output / "reference")):
            remove_stale_temporaries(folder)
            if not _is_begun(folder, family, drawing.get(folder)):
                raise UsageError("holds EXR files of another origin", path=folder, cure="choose an empty folder")
        for index in range(frames):
            for folder, draws in drawing.items():
                path = make_folder(folder) / f"{family}.{index:04d}.exr"
                if not path.exists():
                    draws(path, index)
            progress(index + 1, frames)


def _is_begun(folder: Path, family: str, draws: Callable[[Path, int], None] | None) -> bool:
    """Return whether all EXR files in ``folder`` are named as frames, and ``draws`` gives the first the same bytes."""
    found = sorted(folder.glob("*.exr"))
    numbers = [int(n[1]) for path in found if (n := re.fullmatch(rf"{family}\.(\d+)\.exr", path.name))]
    if not found or draws is None or len(numbers) < len(found):
        return not found
    with temporary_folder(folder) as place:
        draws(place / found[0].name, numbers[0])
        return (place / found[0].name).read_bytes() == found[0].read_bytes()


@click.command(short_help="Ray-cast a scene that declares no effects.")
@click.argument("family", type=click.Choice(sorted(FAMILIES)))
@click.option("-o", "--output", type=FILE_PATH, required=True, help="Folder for the sequence; created if missing.")
@click.option("--frames", type=click.IntRange(1), default=48, help="Number of frames.")
@click.option("--size", type=SIZE, default="320x180", help="Size of a frame in pixels.")
@click.option("--period", type=click.IntRange(1, 1 << 16), default=64, help="Period of the Halton jitter.")
@click.option(
    "--reference",
    type=COUNT_OR_0,
    default=0,
    help="Also draw the truth, N samples a pixel, a square, into reference/.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of colours, placement and phase.")
@json_option
def raycast(
    family: str, output: Path, frames: int, size: tuple[int, int], period: int, reference: int, seed: int, as_json: bool
) -> None:
    """Ray-cast FAMILY into a jittered EXR sequence with exact depth and motion vectors, which declares no effects.

    Frames of most other tools declare none either. The same command continues an interrupted run.
    """
    draw(family, output, frames, size, period, reference, seed)
    if as_json:
        told = {"folder": str(output), "family": family, "frames": frames, "width": size[0], "height": size[1]}
        click.echo(json_of(told | {"reference": reference, "seed": seed}))


raycast.epilog = "Families. " + " ".join(f"{name}: {make.__doc__}" for name, make in FAMILIES.items())
