"""The variants that are measured, and which of them beats which."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cltaa.core.build import Real, Storage
from cltaa.core.parameters import Box, Choices
from cltaa.core.presets import Preset, Published, load_preset
from cltaa.lab.bench.accuracy.measurement import dominated_by, exponential_noise
from cltaa.lab.bench.variants import DEFAULT, PRESETS, Variant, ladder
from cltaa.lab.timing import Clock, Sample, Samples
from cltaa.reference.launcher import NumpyLauncher


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


def test_what_is_published_is_measured_as_published() -> None:
    """The plan leaves nothing out of it, nor of a step from it, whatever a sequence declares."""
    rungs = ladder(load_preset("karis"), [load_preset("default"), load_preset("fsr3-like")])
    own = [rung for rung in rungs if rung.name == "default"]
    assert [rung.preset.published for rung in own] == [Published.NO]
    assert {rung.preset.published for rung in rungs if rung not in own} == {Published.ENGINE}


def test_a_step_changes_one_thing() -> None:
    base, *others = ladder(load_preset())
    assert len({rung.name for rung in others}) == len(others)
    unnamed = [msgspec.structs.replace(rung, name="", group="") for rung in (base, *others)]
    assert all(rung not in unnamed[:at] for at, rung in enumerate(unnamed))
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


def test_presets_join() -> None:
    base = load_preset()
    other = Preset(name="other", description="", settings=base.settings)
    rungs = ladder(base, [base, other])
    assert [rung.name for rung in rungs if rung.group == PRESETS] == ["other"]
    assert len({rung.name for rung in rungs}) == len(rungs)


def samples_of(times: Mapping[str, Sequence[float]]) -> Samples:
    found = Samples()
    for name, values in times.items():
        for seconds in values:
            found.add(name, Sample(seconds))
    return found


def test_the_beaten_are_named_with_what_beats_them_by_the_least_error() -> None:
    times = {"fast": 1.0, "good": 9.0, "middle": 3.0, "worse": 4.0, "worst": 9.5}
    errors = {"fast": 9.0, "good": 1.0, "middle": 3.0, "worse": 3.0, "worst": 9.0}
    assert dominated_by(errors, lambda a, b: times[a] < times[b]) == {"worse": "middle", "worst": "good"}


def test_what_times_cannot_tell_apart_is_not_beaten() -> None:
    # Medians say 1.0, 1.01 and 1.5; of the first two the rounds are for either, of the third for none.
    times = {"good": [0.9, 1.1] * 10 + [1.0], "near": [1.11, 0.91] * 10 + [1.01], "slow": [1.5] * 21}
    errors = {"good": 1.0, "near": 2.0, "slow": 2.0}
    found = samples_of(times)
    assert np.median(times["good"]) < np.median(times["near"])
    assert dominated_by(errors, lambda a, b: found.faster(a, b, Clock.WALL)) == {"slow": "good"}
    # Where the load comes and goes, but the first is the faster in every round, the second is beaten.
    load = [1.0, 1.3, 2.0] * 7
    longer = [1.01 * seconds for seconds in load]
    assert samples_of({"good": load, "near": longer}).faster("good", "near", Clock.WALL)
    assert not samples_of({"good": load, "near": longer}).faster("near", "good", Clock.WALL)


@pytest.mark.parametrize("weight", [0.05, 0.1, 1.0])
def test_noise_of_an_exponential_mean(weight: float) -> None:
    random, mean = np.random.default_rng(0), np.zeros(4000)
    for _ in range(int(20 / weight)):
        mean += weight * (random.normal(0.0, 3.0, mean.size) - mean)
    # The variance of 4000 means is known to within 2.2 % (one standard deviation).
    assert float(mean.var()) == pytest.approx(exponential_noise(9.0, weight), rel=0.09)


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=12))
def test_beaten_is_what_sorting_says(points: list[tuple[int, int]]) -> None:
    times, errors = ({str(place): float(point[axis]) for place, point in enumerate(points)} for axis in (0, 1))
    found = dominated_by(errors, lambda a, b: times[a] < times[b])
    for name in times:
        better = [other for other in times if times[other] < times[name] and errors[other] <= errors[name]]
        assert (name in found) is bool(better)
        if better:
            assert found[name] in better
            assert errors[found[name]] == min(errors[other] for other in better)


def test_a_variant_is_resolved_on_the_device_that_is_named() -> None:
    assert isinstance(Variant.of(load_preset()).resolver("numpy").launcher, NumpyLauncher)
