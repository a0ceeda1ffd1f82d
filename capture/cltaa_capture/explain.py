"""Explain what a capture draws and writes for each effect, what it leaves out, and the cost of each.

The cost is processor time of all threads, because llvmpipe draws on the processor; other programs do not count. Frames
are drawn and written with and without an effect, in turn.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from cltaa.frame import Effect
from cltaa.io.exr_write import write_frame
from cltaa_capture.osmesa import open_context
from cltaa_datasets.scene import Instant, Scene, Sun

ROUNDS = 9
SHADOW = "shadow map"
SHADOW_DRAWN_AS = "one depth picture from a sun, drawn before the frame"
# Effects with drawing of their own; the others only affect colour and attributes.
DRAWN = (Effect.MOTION, Effect.REACTIVE, Effect.ALPHA, Effect.SKY)
Change = Callable[[Instant], Instant]
INSTANT, BEFORE = 0.5, 0.5 - 1.0 / 30.0  # seconds: a frame in the middle of the action


def measure_costs(scene: Scene, width: int, height: int, backend: str = "auto") -> dict[str, float]:
    """Return the processor seconds per frame that each of ``DRAWN``, and a shadow map, takes in ``scene``, or would
    take: medians of paired differences over ``ROUNDS`` rounds."""
    variants: dict[str, tuple[Scene, Change]] = {"as it is": (scene, lambda instant: instant)}
    for effect in DRAWN:
        variants[effect] = replace(scene, effects=scene.effects ^ {effect}), lambda instant: instant
    if casts_shadow(scene):
        variants[SHADOW] = scene, _without_shadow
    with ExitStack() as stack:
        stack.enter_context(closing(open_context(backend)))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cltaa-explain-")))
        runs = {
            name: _drawing(variant, change, (width, height), folder, stack)
            for name, (variant, change) in variants.items()
        }
        return _paired(runs, {name for name in runs if name == SHADOW or name in scene.effects})


def casts_shadow(scene: Scene) -> bool:
    """Return whether a sun of the scene casts shadows."""
    return any(isinstance(light, Sun) and light.shadow is not None for light in scene.at(INSTANT).lights)


def _without_shadow(instant: Instant) -> Instant:
    lights = (replace(light, shadow=None) if isinstance(light, Sun) else light for light in instant.lights)
    return replace(instant, lights=tuple(lights))


def _drawing(scene: Scene, change: Change, size: tuple[int, int], folder: Path, stack: ExitStack) -> Callable[[], None]:
    """Return a call that draws and writes one frame of a scene; ``stack`` frees its resources."""
    from cltaa_capture.render import SceneRenderer  # imported late: binds PyOpenGL to the platform chosen by now

    renderer = SceneRenderer(scene, *size)
    stack.callback(renderer.delete)
    now = change(scene.at(INSTANT))
    # A scene without motion must not move.
    before = change(scene.at(BEFORE)) if Effect.MOTION in scene.effects else now

    def run() -> None:
        drawn = renderer.draw(now, before, (0.0, 0.0))
        write_frame(folder / "frame.0000.exr", drawn.frame(scene, now, index=0, jitter_px=(0.0, 0.0), cut=False))

    return run


def _paired(runs: dict[str, Callable[[], None]], present: set[str]) -> dict[str, float]:
    """Return the seconds by which each variant differs from the first; positive is the cost of the effect."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for number in range(ROUNDS + 1):
        for name, run in runs.items():
            started = time.process_time()
            run()
            if number:  # the first round compiles shaders
                seconds[name].append(time.process_time() - started)
    base, *others = runs
    differences = {name: median(a - b for a, b in zip(seconds[base], seconds[name], strict=True)) for name in others}
    return {name: value if name in present else -value for name, value in differences.items()}


BYTES_A_CHANNEL = 4  # float32

# Effect -> (how it is drawn, channels that it adds to a frame)
DRAWN_AS: dict[Effect, tuple[str, tuple[str, ...]]] = {
    Effect.CAMERA: ("another world_to_view or view_to_clip every frame", ()),
    Effect.MOTION: ("previous poses; motion of what moves by itself", ("backward.u", "backward.v")),
    Effect.DISOCCLUSION: ("nothing of its own: depth tells", ()),
    Effect.THIN: ("nothing of its own: depth tells", ()),
    Effect.HDR: ("nothing of its own: colour is never clamped", ()),
    Effect.ILLUMINATION: ("nothing of its own: it is in the colour", ()),
    Effect.REACTIVE: ("share of see-through surfaces", ("reactive",)),
    Effect.EXPOSURE: ("attribute cltaa:exposure", ()),
    Effect.CUT: ("attribute cltaa:cut", ()),
    Effect.ALPHA: ("coverage", ("A",)),
    Effect.SKY: ("a full-screen pass behind everything; its depth is +inf", ()),
    Effect.NOISE: ("nothing: no sample is drawn by chance", ()),
}
ALWAYS = ("R", "G", "B", "Z")


@dataclass(frozen=True, slots=True)
class Explanation:
    """One effect, or pass, of one scene."""

    effect: str
    on: bool
    reason: str
    channels: tuple[str, ...]
    bytes_a_frame: int  # uncompressed
    milliseconds: float | None = None  # processor time to draw and write it, even if it is off


def explain(scene: Scene, width: int, height: int, seconds: Mapping[str, float]) -> list[Explanation]:
    """Return for every effect whether ``scene`` declares it, and what it adds to a frame of this size.

    ``seconds`` is the result of ``measure_costs``.
    """

    def cost(name: str) -> float | None:
        return round(seconds[name] * 1e3, 3) if name in seconds else None

    explanations = []
    for effect, (drawn_as, channels) in DRAWN_AS.items():
        on = effect in scene.effects
        reason = f"declared by the scene: {drawn_as}" if on else "not declared: not drawn, not stored"
        added = channels if on else ()
        size = len(added) * BYTES_A_CHANNEL * width * height
        explanations.append(Explanation(effect, on, reason, added, size, cost(effect)))
    casts = casts_shadow(scene)
    reason = (
        f"a sun of the scene casts shadows: {SHADOW_DRAWN_AS}" if casts else "no sun casts shadows: no map, no look-up"
    )
    explanations.append(Explanation(SHADOW, casts, reason, (), 0, cost(SHADOW)))
    return explanations
