"""The fused kernel against its NumPy twin for every choice: several choices in one build.

A build takes seconds to compile, so choices that do not bear on one another share one. Of each group at most one is not
as usual, lest one hide what another does.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from cltaa.core.build import Terms
from cltaa.core.parameters import Choices, Illumination, Rectify
from cltaa.core.presets import load_preset
from cltaa.frame import Effect
from tests.kernels.test_resolve import ALONE, CHOICES, differing, hard_frames

Row = dict[str, Any]  # choices by name

LANES, ROWS, SEED = 8, 7, 19  # with it every box is tried where something is moved into it
GROUPS = [
    ("box", "box_space", "neighbourhood", "variance"),
    ("rectify",),
    ("history_filter", "weighting"),
    ("current_filter", "filter_use", "history_range"),
    ("accumulate", "anti_flicker", "fireflies", "negatives"),
    ("dilation", "off_screen", "ray_through", "reject"),
    ("exposure_change", "illumination", "reactive_mask", "tonemap"),
]
# What a choice needs to be seen: the usual box knows no variance.
BESIDE = {"variance": {"box": "variance"}}
CHOSEN = [name for group in GROUPS for name in group]
# For frames that declare no effects, which no illumination change is looked for in. A box says nothing of history that
# nothing moves into it.
USUAL = msgspec.structs.replace(load_preset().choices, illumination=Illumination.STATIC, rectify=Rectify.CLAMP)


def alternatives(group: Sequence[str]) -> list[Row]:
    """What a row may have of a group: all as usual, or one value that is not."""
    rare = [(name, value) for name in group for value in CHOICES[name] if value is not getattr(USUAL, name)]
    return [{}, *({name: value, **BESIDE.get(name, {})} for name, value in rare)]


def rows(chance: random.Random) -> Iterator[Row]:
    """The alternatives of all groups beside one another: each group's again and again, each time shuffled, until the
    longest is through."""
    count, columns = max(len(alternatives(group)) for group in GROUPS), []
    for group in GROUPS:
        column: list[Row] = []
        while len(column) < count:
            column += chance.sample(alternatives(group), len(alternatives(group)))
        columns.append(column[:count])
    for parts in zip(*columns, strict=True):
        yield {name: value for part in parts for name, value in part.items()}


CASES = list(rows(random.Random(SEED)))


def differing_with(row: Row) -> int:
    """Values that differ between kernel and twin, over three frames."""
    with pytest.MonkeyPatch.context() as patch:
        # The first frame has nothing to blur, which changes no bit (test_terms.py): it needs no kernel of its own.
        patch.setattr("cltaa.core.build.Terms.of", lambda _: Terms())
        effects = frozenset(Effect) if "illumination" in row else None
        frames = [replace(frame, effects=effects) for frame in hard_frames()]
        return differing({"rectify": USUAL.rectify, **row, "disocclusion_blur": 0.5}, frames, LANES, ROWS)


def needed(row: Row, fails: Callable[[Row], bool]) -> Row:
    """What of a failing row it takes to fail: all else can be as usual at once."""
    for name in list(row):
        less = {other: value for other, value in row.items() if other != name}
        if fails(less):
            row = less
    return row


@pytest.mark.parametrize("row", CASES, ids=range(len(CASES)))
def test_same_bits_for_every_choice(row: Row) -> None:
    if different := differing_with(row):
        culprits = needed(row, lambda less: differing_with(less) > 0)
        pytest.fail(f"{different} values differ by {culprits or 'whatever is chosen'}")


def test_every_value_is_tried_where_it_is_seen() -> None:
    assert sorted([*CHOSEN, *ALONE]) == sorted(Choices.__struct_fields__)
    for group in GROUPS:
        for alternative in alternatives(group):
            own = [row for row in CASES if {name: row[name] for name in group if name in row} == alternative]
            assert any(group is not GROUPS[0] or row.get("rectify") is not Rectify.NONE for row in own), alternative


def test_what_it_takes_to_fail_is_found() -> None:
    row = {"a": 1, "c": 2, "d": 3}
    assert needed(row, lambda it: it.get("c") == 2) == {"c": 2}
    assert needed(row, lambda it: {"a", "d"} <= set(it)) == {"a": 1, "d": 3}
    assert needed(row, lambda _: True) == {}
