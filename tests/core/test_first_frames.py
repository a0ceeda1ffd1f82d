"""The first frame of each published preset, which has no history: bits that are changed knowingly or not at all."""

from __future__ import annotations

import hashlib

import numpy as np

from cltaa.core.presets import load_preset, preset_names
from cltaa.core.resolver import Resolver
from tests.sequence_factory import bits, make_frame

# preset -> what its first frame is: the frame itself, or bits with this hash where a filter or a transform comes first
ITSELF = "the frame itself"
FIRST = {
    "babylon-accumulate": ITSELF,
    "babylon-disable-on-camera-move": ITSELF,
    "babylon-reproject": ITSELF,
    "babylon-reproject-clamp": ITSELF,
    "bevy": "0c102315ec32bc12",
    "filament": "77ccc1a38ef95066",
    "fsr3-like": "cada77d6ea34c13d",
    "godot": "bf9df5cb5b3eb0b7",
    "intel": "a5b3941e921345a7",
    "karis": "f046f2dae60c1272",
    "playdead": "76db6c76ef05550e",
    "simvx": ITSELF,
    "vireo-article": ITSELF,
    "vireo-source": ITSELF,
}


def first_frame(name: str) -> str:
    frame = make_frame(0, motion=True, effects=None)
    image = Resolver(load_preset(name), "numpy").resolve(frame)
    if np.array_equal(bits(image[..., :3]), bits(frame.colour)):
        return ITSELF
    return hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()[:16]


def test_the_first_frame_has_its_bits() -> None:
    assert {name: first_frame(name) for name in preset_names() if load_preset(name).published} == FIRST
