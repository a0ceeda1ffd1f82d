"""What a writer may have meant by two matrices that are not read as they were meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

from cltaa.frames import Camera
from cltaa.inputs.convert import mended_camera
from cltaa.inputs.profile import Cameras

Change = Callable[[Camera], Camera]


class Meaning(NamedTuple):
    """What it is called, the keys of a profile that say so, and the camera that was meant."""

    what: str
    fix: dict[str, Any]

    def change(self, camera: Camera) -> Camera:
        """``camera``, which was read as declared, as it was meant; raises LinAlgError where it cannot be."""
        rule = Cameras(**self.fix)
        return mended_camera(camera.world_to_view, camera.view_to_clip, rule, (0.0, 0.0), 1, 1)


_TRANSPOSED = {"transposed": Meaning("the matrices are transposed", {"layout": "column"})}
_HALF_TRANSPOSED = {
    "view-transposed": Meaning("the view matrix is transposed", {"view_layout": "column"}),
    "projection-transposed": Meaning("the projection is transposed", {"projection_layout": "column"}),
}
_INVERSE = {"inverse": Meaning("the view matrix leads from camera to world", {"sense": "camera-to-world"})}
_AXES = {
    "z-forward": Meaning("view space looks along +z", {"flip_z": True}),
    "z-forward-projection": Meaning("view and projection look along +z", {"flip_z": True, "flip_projection_z": True}),
    "mirrored": Meaning("the world is left-handed", {"mirrored": True}),
    "left-handed": Meaning(
        "world, view and projection are left-handed", {"flip_z": True, "flip_projection_z": True, "mirrored": True}
    ),
}
_FLIPPED = {"y-flipped": Meaning("the projection's y points down", {"flip_y": True})}


def _together(*choices: Mapping[str, Meaning]) -> dict[str, Meaning]:
    """One of each of ``choices``, at once."""
    made = {}
    for parts in product(*(choice.items() for choice in choices)):
        there = [(name, meaning) for name, meaning in parts if name]
        fix = {key: value for _, meaning in there for key, value in meaning.fix.items()}
        made["-".join(name for name, _ in there)] = Meaning(", and ".join(m.what for _, m in there), fix)
    return made


_NOT = {"": Meaning("", {})}
# The crude ones, one at a time: each can be seen by itself.
MEANINGS = _TRANSPOSED | _HALF_TRANSPOSED | _INVERSE | _AXES | _FLIPPED | _together(_TRANSPOSED, _AXES)
# Any of them at once, and none of them, under the empty name.
COMBINED = _together(_NOT | _TRANSPOSED, _NOT | _INVERSE, _NOT | _AXES, _NOT | _FLIPPED)
