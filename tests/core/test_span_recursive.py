"""The recursive resolve beside the spans of the past: what it reads, what goes on from it, and how much it counts."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.reference.span_recursive import recursive_share
from tests.core.test_spans import declared
from tests.sequence_factory import bits


def test_beside_the_spans_runs_the_resolve_of_the_default() -> None:
    as_default = override(load_preset("default"), {"change_floor": load_preset("t5").settings.change_floor})
    spans, alone = Resolver(override(load_preset("t5"), {"frames_kept": 9}), "numpy"), Resolver(as_default, "numpy")
    for frame in declared(10):
        shown, expected = spans.resolve(frame), alone.resolve(frame)
        (past, recurs), (_, recurs_alone) = spans.recurrent(), alone.recurrent()
        assert past.holds_changes
        for name, buffer in recurs_alone.items():
            with buffer.mapped(write=False) as planes, recurs[name].mapped(write=False) as found:
                assert (bits(found) == bits(planes)).all()
    assert not np.array_equal(shown, expected)


def test_what_recurs_beside_the_spans_is_all_that_goes_on() -> None:
    preset = override(load_preset("t5"), {"frames_kept": 9})
    frames = list(declared(8))
    whole, later = Resolver(preset, "numpy"), Resolver(preset, "numpy")
    for frame in frames[:5]:
        whole.resolve(frame)
    past, memory = whole.recurrent()
    for name, target in later.restore(past).items():
        with memory[name].mapped(write=False) as held, target.mapped(write=True) as planes:
            planes[...] = held
    for frame in frames[5:]:
        shown = whole.resolve(frame)
        assert (bits(later.resolve(frame)) == bits(shown)).all()
    whole.run_again(frames[-1], frames[-2])
    assert whole.last is not None
    with whole.last.arguments["output"].mapped(write=False) as planes:
        again = np.moveaxis(whole.last.layout.inside(planes)[: shown.shape[-1]], 0, -1)
        assert (bits(again) == bits(shown)).all()


@pytest.mark.parametrize(
    ("recursive", "spans", "share"),
    [
        (1.0, 1.0, 0.85),  # few samples in both
        (1.0, 5.0, 0.75),
        (1.0, 20.0, 35 / 400),  # many in the spans
        (3.5, 10.0, 0.35 / 2),
        (5.0, 10.0, 0.0),  # neither begun anew nor lasted
        (5.0, 5.0, 0.75),  # few in the spans
        (100.0, 5.5, 3.75 / 5.5 / 2),  # light that the recursive result may lag behind
        (100.0, 6.5, 0.0),
        (8.0, 32.0, 0.5 / 25),
        (32.0, 32.0, 0.25),
        (96.0, 10.5, (96 / 106.5) ** 2 / 2),
    ],
)
def test_a_recursive_result_counts_where_it_has_begun_anew_or_lasted(
    recursive: float, spans: float, share: float
) -> None:
    planes = (np.array([[samples]], np.float32) for samples in (recursive, spans, 4.0))
    found = recursive_share(*planes)
    assert found[0, 0] == pytest.approx(share, rel=1e-6, abs=1e-7)
