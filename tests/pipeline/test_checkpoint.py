"""A resolver that was put back from disk goes on with the same bits, or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.core.build import Storage
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame, Image
from cltaa.pipeline.checkpoint import SLOTS, Checkpoints
from tests.sequence_factory import bits, make_frame

KEY, MADE = "of these settings", "of these inputs"


def frames(count: int, *, alpha: bool = False) -> list[Frame]:
    return [
        make_frame(index, motion=True, alpha=alpha, effects=None, exposure=1.0 + index / 7) for index in range(count)
    ]


def resolved(sequence: list[Frame], **options: object) -> tuple[Resolver, list[Image]]:
    resolver = Resolver(**options)  # type: ignore[arg-type]
    return resolver, [resolver.resolve(frame) for frame in sequence]


@pytest.mark.parametrize(
    ("options", "alpha"),
    [
        ({"preset": "fast", "storage": Storage.HALF}, True),
        ({"device": "numpy"}, False),
        ({"preset": "gather-8", "device": "numpy"}, True),
    ],
    ids=["half", "numpy", "ring"],
)
def test_restored_resolver_gives_the_same_bits(tmp_path: Path, options: dict[str, object], alpha: bool) -> None:
    sequence = frames(6, alpha=alpha)
    _, whole = resolved(sequence, **options)
    resolver, _ = resolved(sequence[:3], **options)
    Checkpoints(tmp_path, KEY).save(resolver, MADE)
    other = Resolver(**options)  # type: ignore[arg-type]
    assert Checkpoints(tmp_path, KEY).restore(other, dict.fromkeys(range(6), MADE)) == 2
    for frame, expected in zip(sequence[3:], whole[3:], strict=True):
        assert np.array_equal(bits(other.resolve(frame)), bits(expected))


def test_latest_slot_below_the_wanted_frame_is_taken(tmp_path: Path) -> None:
    checkpoints, resolver = Checkpoints(tmp_path, KEY), Resolver(device="numpy")
    for frame in frames(5):
        resolver.resolve(frame)
        checkpoints.save(resolver, MADE)
    # Saved after each of 0 to 4: the slots hold the last two.
    for before, expected in ((9, 4), (5, 4), (4, 3), (3, None)):
        assert (
            Checkpoints(tmp_path, KEY).restore(Resolver(device="numpy"), dict.fromkeys(range(before), MADE)) == expected
        )
    assert Checkpoints(tmp_path, "of others").restore(Resolver(device="numpy"), dict.fromkeys(range(9), MADE)) is None
    checkpoints.clear()
    assert list(tmp_path.iterdir()) == []


def test_nothing_to_save_before_the_first_frame(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no history"):
        Checkpoints(tmp_path, KEY).save(Resolver(), MADE)


def test_damaged_slot_never_gives_other_bits(tmp_path: Path) -> None:
    """Any byte changed, or the file cut anywhere: the older slot is taken, or the same state comes out."""
    checkpoints, resolver = Checkpoints(tmp_path, KEY), Resolver(device="numpy")
    for frame in frames(2):
        resolver.resolve(frame)
        checkpoints.save(resolver, MADE)
    newest = max((tmp_path / name for name in SLOTS), key=lambda path: path.stat().st_mtime_ns)
    _, buffers = resolver.recurrent()
    expected = {name: bits(np.array(_content(buffer))) for name, buffer in buffers.items()}
    whole = newest.read_bytes()
    random = np.random.default_rng(0)
    outcomes = set()
    for trial in range(120):
        position = int(random.integers(len(whole)))
        damaged = bytearray(whole)
        if trial % 3:
            damaged[position] ^= int(random.integers(1, 256))
        else:
            del damaged[position:]
        newest.write_bytes(damaged)
        other = Resolver(device="numpy")
        restored = checkpoints.restore(other, dict.fromkeys(range(9), MADE))
        outcomes.add(restored)
        if restored == 1:
            _, again = other.recurrent()
            for name, buffer in again.items():
                assert np.array_equal(bits(np.array(_content(buffer))), expected[name]), position
        else:
            assert restored == 0
    assert 0 in outcomes


def _content(buffer: object) -> Image:
    with buffer.mapped(write=False) as planes:  # type: ignore[attr-defined]
        return planes.copy()  # type: ignore[no-any-return]
