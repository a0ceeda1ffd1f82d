"""What a capture draws and writes for each effect, and what it leaves out because the scene does not call for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cltaa.frame import Effect
from cltaa_capture.costs import SHADOW, casts_shadow
from cltaa_datasets.scene import Scene

BYTES_A_CHANNEL = 4  # float32

# Effect -> (what it is drawn as, channels that it adds to a frame)
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
}
ALWAYS = ("R", "G", "B", "Z")


SHADOW_DRAWN_AS = "one depth picture from a sun, drawn before the frame"


@dataclass(frozen=True, slots=True)
class Explanation:
    """One effect, or pass, of one scene."""

    effect: str
    on: bool
    reason: str
    channels: tuple[str, ...]
    bytes_a_frame: int  # uncompressed
    milliseconds: float | None = None  # processor time to draw and write it; where it is off, what it would take


def explain(scene: Scene, width: int, height: int, seconds: Mapping[str, float] | None = None) -> list[Explanation]:
    """Say of every effect whether ``scene`` calls for it, and what that adds to a frame of this size.

    ``seconds`` is what ``costs.measure_costs`` found.
    """
    seconds = seconds or {}

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
