"""Values of options that are several in one text."""

from __future__ import annotations

import click
import pytest

from cltaa.commands.options import FROM_0, FROM_2, SECONDS, SIZE, SOME_FRAMES, listed


def test_option_values_are_parsed() -> None:
    for kind, text, value in [
        (SIZE, "640x360", (640, 360)),
        (SIZE, "640X360", (640, 360)),
        (SOME_FRAMES, "8-47", (8, 47)),
        (SOME_FRAMES, "-3", (-3, -3)),
        (SOME_FRAMES, "12", 12),
        (FROM_0, "0, 7", (0, 7)),
        (FROM_0, "", ()),
        (FROM_2, "2,4", (2, 4)),
    ]:
        assert kind.convert(text, None, None) == value, text


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (SIZE, "0x4"),
        (SIZE, "640"),
        (SIZE, "1" * 5000 + "x1"),
        (SOME_FRAMES, "-"),
        (SOME_FRAMES, "2..3"),
        (SOME_FRAMES, "1" * 5000),
        (FROM_0, "-1"),
        (FROM_0, "1" * 5000),
        (FROM_2, "2,1"),
    ],
    ids=lambda value: value[:8] if isinstance(value, str) else value.name,
)
def test_wrong_option_values_are_refused(kind: click.ParamType[tuple[object, ...]], text: str) -> None:
    with pytest.raises(click.BadParameter, match=text):
        kind.convert(text, None, None)


def test_a_time_may_have_its_unit() -> None:
    assert [SECONDS.convert(text, None, None) for text in ("5s", "0.5 s", "5")] == [5.0, 0.5, 5.0]


def test_spaces_and_empty_names_of_a_list_count_as_nothing() -> None:
    assert listed(" zip, piz,") == ("zip", "piz")
    assert listed("") == ()
