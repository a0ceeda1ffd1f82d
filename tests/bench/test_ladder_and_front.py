"""The variants that are measured, and which of them beats which."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cltaa.bench.front import dominated_by
from cltaa.bench.ladder import COMBINATIONS, DEFAULT, PRESETS, ladder
from cltaa.bench.results import exponential_noise
from cltaa.build import Real, Storage
from cltaa.params import Box, Choices
from cltaa.presets import Preset, load_preset


def test_every_choice_and_storage_is_a_rung() -> None:
    base = load_preset()
    rungs = ladder(base)
    assert rungs[0].group == DEFAULT
    assert (rungs[0].choices, rungs[0].settings) == (base.choices, base.settings)
    for field in Choices.__struct_fields__:
        kind: type[StrEnum] = type(getattr(base.choices, field))
        assert {getattr(rung.choices, field) for rung in rungs} == set(kind)
    assert {rung.storage for rung in rungs} == set(Storage)
    assert {rung.real for rung in rungs} == set(Real)
    assert any(rung.strict for rung in rungs)


def test_a_step_changes_one_thing() -> None:
    base, *others = ladder(load_preset())
    assert len({rung.name for rung in others}) == len(others)
    for rung in others:
        changed = [
            field
            for field in Choices.__struct_fields__
            if getattr(rung.choices, field) is not getattr(base.choices, field)
        ]
        changed += [
            name for name in ("storage", "real", "strict", "relaxed") if getattr(rung, name) != getattr(base, name)
        ]
        settings = [
            name
            for name in type(base.settings).__struct_fields__
            if getattr(rung.settings, name) != getattr(base.settings, name)
        ]
        if changed == ["storage", "real"]:  # the numbers are a grid
            continue
        if changed in (["neighbourhood", "box"], ["variance", "box"]):  # what only a box of deviations shows
            assert (rung.choices.box, settings) == (Box.VARIANCE, [])
            continue
        # An exponential blend is one step with its weight; the default's own weight is no change.
        assert len(changed) + len(settings) == 1 or (changed, settings) == (["accumulate"], ["blend_weight"]), rung.name


def test_presets_and_combinations_join() -> None:
    base = load_preset()
    other = Preset(name="other", description="", settings=base.settings)
    rungs = ladder(base, [base, other], full=True)
    assert [rung.name for rung in rungs if rung.group == PRESETS] == ["other"]
    grid = [rung for rung in rungs if rung.group == COMBINATIONS]
    assert len({(rung.choices, rung.storage) for rung in rungs if rung.group != PRESETS}) >= len(grid)
    assert len({rung.name for rung in rungs}) == len(rungs)


def test_the_dominated_are_named_with_what_beats_them() -> None:
    points = {"fast": (1.0, 9.0), "good": (9.0, 1.0), "middle": (3.0, 3.0), "worse": (4.0, 3.0), "worst": (9.0, 9.0)}
    assert dominated_by(points) == {"worse": "middle", "worst": "good"}


@pytest.mark.parametrize("weight", [0.05, 0.1, 1.0])
def test_noise_of_an_exponential_mean(weight: float) -> None:
    random, mean = np.random.default_rng(0), np.zeros(4000)
    for _ in range(int(20 / weight)):
        mean += weight * (random.normal(0.0, 3.0, mean.size) - mean)
    # The variance of 4000 means is known to within 2.2 % (one standard deviation).
    assert float(mean.var()) == pytest.approx(exponential_noise(9.0, weight), rel=0.09)


def test_equal_points_do_not_beat_each_other() -> None:
    assert dominated_by({"a": (1.0, 1.0), "b": (1.0, 1.0)}) == {}


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=12))
def test_front_is_what_sorting_says(points: list[tuple[int, int]]) -> None:
    named = {str(place): (float(time), float(error)) for place, (time, error) in enumerate(points)}
    found = dominated_by(named)
    front = set(named) - set(found)
    for name, (time, error) in named.items():
        beaten = any(t <= time and e <= error and (t, e) != (time, error) for t, e in named.values())
        assert (name in found) is beaten
        if name in found:
            assert found[name] in front
            assert np.all(np.array(named[found[name]]) <= (time, error))
