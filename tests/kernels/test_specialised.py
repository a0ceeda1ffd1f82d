"""What a plan leaves out is not in the compiled kernel: its code is poisoned, and the kernel builds all the same.

The poison is a call of a function that nothing defines. A program that still holds the call cannot be linked; so a
build proves that the compiler threw the code away, and the same poison must fail where the step is on.
"""

from __future__ import annotations

import re
import warnings
from collections import ChainMap
from collections.abc import Callable

import msgspec
import pyopencl as cl
import pytest

from cltaa.core.build import Build, Steps, Terms, source
from cltaa.core.parameters import (
    Box,
    Choices,
    Dilation,
    HistoryFilter,
    Illumination,
    Rectify,
    Reject,
    Variance,
    Weighting,
)
from cltaa.opencl.device import POCL, Device, devices

pytestmark = pytest.mark.optimised  # what is left out without it is still linked

BARE = Steps(camera_motion=False, own_motion=False, orthographic=False, exposure=False, alpha=False, reactive=False)
PLAIN = Choices(rectify=Rectify.NONE, dilation=Dilation.NONE, reject=Reject.NONE, weighting=Weighting.NONE)
IDLE = Terms(**dict.fromkeys(Terms.__struct_fields__, False))
LEAST = Build(choices=PLAIN, steps=BARE, terms=IDLE, lanes=8, rows=4)

# Step -> (a word that only its code holds, what turns it on among steps and choices).
CODE: dict[str, tuple[str, dict[str, bool], dict[str, object]]] = {
    "reprojection": ("SPLAT(LEAST_W)", {"camera_motion": True}, {}),
    "own motion": ("outside_domain(s.u)", {"own_motion": True}, {}),
    # Where nothing moves the history is read at its texels: no filter is left.
    "history filter": ("load_history(p + 2)", {"camera_motion": True}, {}),
    "exposure": ("SPLAT(frame.exposure_ratio)", {"exposure": True}, {}),
    "alpha": ("load(alpha)", {"alpha": True}, {}),
    "reactive": ("load_share(reactive + at, SPLAT(0.0))", {"reactive": True}, {}),
    "rejection": ("K(settings.depth_tolerance)", {}, {"reject": Reject.DEPTH}),
    "rectification": ("K(settings.box_floor)", {}, {"rectify": Rectify.CLIP}),
    "illumination change": ("SPLAT(settings.illumination_t)", {}, {"illumination": Illumination.TEST}),
    "dilation": ("K(settings.edge_tolerance)", {}, {"dilation": Dilation.EDGE}),
    "naive variance": (
        "centre * centre",
        {},
        {"rectify": Rectify.CLAMP, "box": Box.VARIANCE, "variance": Variance.NAIVE},
    ),
    "six taps": ("K(0.105)", {"camera_motion": True}, {"history_filter": HistoryFilter.CROSS_20}),
    "luminance weights": ("SPLAT(settings.luminance_knee)", {}, {"weighting": Weighting.LUMINANCE}),
}
# Term of the settings -> a word that only its code holds.
TERMS = {
    "resampling_penalty": "K(settings.resampling_penalty)",
    "box_scale_by_motion": "K(settings.box_scale_static)",
    "disocclusion_blur": "SPLAT(settings.disocclusion_blur)",
    "first_samples": "settings.first_samples",
    "luma_scale": "K(settings.luma_scale)",
    "box_leak": "SPLAT(settings.box_leak)",
}


# The code that a build still holds, of some words each of which only one step's code holds.
Held = Callable[[list[str], Build], set[str]]


@pytest.fixture(scope="module")
def held() -> Held:
    # PoCL says which symbols it misses; other drivers link later, or not at all.
    if not any(device.platform.name == POCL for device in devices()):
        pytest.skip("PoCL is not installed, and no other driver says which symbols a program misses")
    device = Device(POCL)

    def held_of(words: list[str], how: Build) -> set[str]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            try:
                cl.Program(device.context, poisoned(words, how)).build(options=list(how.flags()))
            except cl.RuntimeError as error:
                if missed := re.findall(r"cltaa_poison_(\d+)\b", str(error)):
                    return {words[int(number)] for number in missed}
                raise
        return set()

    return held_of


def poisoned(words: list[str], how: Build) -> str:
    """The resolve with a call beside each word."""
    text = source("resolve", how)
    for number, word in enumerate(words):
        assert word in text, "the kernels say it in other words now: tell this test"
        text = text.replace(word, f"({word} + cltaa_poison_{number}(0))")
    return "".join(f"int cltaa_poison_{number}(int);\n" for number in range(len(words))) + text


def test_what_is_left_out_is_not_compiled(held: Held) -> None:
    assert held(list(dict.fromkeys(word for word, _, _ in CODE.values())), LEAST) == set()


def test_what_is_called_for_is_compiled(held: Held) -> None:
    words, steps, choices = zip(*CODE.values(), strict=True)
    wanted = msgspec.structs.replace(
        LEAST,
        steps=msgspec.structs.replace(BARE, **ChainMap(*steps)),
        choices=msgspec.structs.replace(PLAIN, **ChainMap(*choices)),
    )
    assert held(list(words), wanted) == set(words)


def test_a_gpu_keeps_no_rows_of_what_stands_still(held: Held) -> None:
    still = msgspec.structs.replace(LEAST, lanes=1)
    assert held(["load_history(p + 2)"], still) == set()
    moving = msgspec.structs.replace(still, steps=msgspec.structs.replace(BARE, own_motion=True))
    assert held(["load_history(p + 2)"], moving) == {"load_history(p + 2)"}


CLAMPED = msgspec.structs.replace(
    LEAST, choices=msgspec.structs.replace(PLAIN, rectify=Rectify.CLAMP, box=Box.VARIANCE)
)


def test_terms_that_come_to_nothing_are_not_compiled(held: Held) -> None:
    assert held(list(TERMS.values()), CLAMPED) == set()


def test_terms_that_are_called_for_are_compiled(held: Held) -> None:
    wanted = msgspec.structs.replace(CLAMPED, terms=Terms())
    assert held(list(TERMS.values()), wanted) == set(TERMS.values())
