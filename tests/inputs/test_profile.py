"""Reader profiles as text: written and read again, built on each other, and refused where they mean nothing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from cltaa.errors import DataError, UsageError
from cltaa.inputs.convert import correct
from cltaa.inputs.profile import assignments_of, load_profile, override, profile_names, toml_text


def test_profiles_survive_toml(tmp_path: Path) -> None:
    for name in profile_names():
        profile = load_profile(name)
        (tmp_path / f"{name}.toml").write_text(toml_text(profile))
        assert load_profile(str(tmp_path / f"{name}.toml")) == profile, name


def test_a_profile_can_build_on_another(tmp_path: Path) -> None:
    path = tmp_path / "studio.toml"
    path.write_text('profile = "blender"\n[depth]\nscale = 100.0\n')
    assert load_profile(str(path)).depth.scale == 100.0
    assert load_profile(str(path)).motion == load_profile("blender").motion


def test_a_correction_goes_on_top() -> None:
    cases: list[tuple[str, dict[str, Any], str]] = [
        ("motion.scale=2,3", {"scale": [10.0, 100.0]}, "motion.scale=20,300"),
        ("motion.scale=2,3", {"scale": [10.0, 100.0], "swap": True}, "motion.scale=30,200 motion.swap=true"),
        ("motion.jittered=1", {"jittered": -1}, "motion.jittered=0"),
        ("motion.jittered=-1", {"jittered": -1}, "motion.jittered=-1"),
        ("motion.jittered=1", {"jittered": 1}, "motion.jittered=1"),
        ("depth.scale=2", {"scale": 3.0}, "depth.scale=6"),
        # The offset of a jitter is added last, so the factors change it too.
        ("jitter.offset=-0.5,0.25", {"scale": [-1.0, 1.0]}, "jitter.scale=-1,1 jitter.offset=0.5,0.25"),
        (
            "jitter.offset=-0.5,0.25",
            {"scale": [2.0, -1.0], "swap": True},
            "jitter.scale=2,-1 jitter.swap=true jitter.offset=0.5,0.5",
        ),
    ]
    for before, change, expected in cases:
        section = before.partition(".")[0]
        ours, theirs = (override(load_profile("cltaa"), re.split(" (?=[a-z])", text)) for text in (before, expected))
        assert correct(ours, {section: change}) == theirs, before


def test_wrong_profiles(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('profile = "blendr"')
    with pytest.raises(UsageError, match=r"a\.toml: unknown profile blendr; did you mean blender\?"):
        load_profile(str(tmp_path / "a.toml"))
    for text, told in (
        ("[", "not TOML"),
        ("[depth]\nkin = 1", r"unknown key depth\.kin; did you mean kind\?"),
        ('speed = "x"', "unknown key speed; known keys: name, .*camera"),
        ('[colour]\nchannels = ["Y"]', r"colour\.channels is not 3 names .*may be named more than once: Y Y Y"),
    ):
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(DataError, match=told):
            load_profile(str(tmp_path / "a.toml"))


@pytest.mark.parametrize("value", [1234567.0, 0.123456789, -1.0, 1e-9, 1e22])
def test_an_option_keeps_every_digit(value: float) -> None:
    made = override(load_profile("cltaa"), assignments_of({"depth": {"scale": value, "sky": value}}))
    assert (made.depth.scale, made.depth.sky) == (value, value)


@pytest.mark.parametrize("bases", [("a.toml",), ("b.toml", "a.toml")])
def test_profiles_that_extend_each_other_in_a_circle_are_refused(
    bases: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, base in zip(("a.toml", "b.toml"), bases, strict=False):
        Path(name).write_text(f'profile = "{base}"')
    with pytest.raises(DataError, match=r"\.toml: the profile extends itself; name another profile"):
        load_profile("a.toml")


def test_an_unknown_value_is_reported_with_the_known_ones() -> None:
    for assignment, message in [
        (
            "colour.channels=Y",
            "is not 3 names (found Y); one channel may be named more than once: Y Y Y",
        ),
        ("depth.channels=", 'depth.channels is not 1 name (found "")'),
        ("motion.channels=u v w", "motion.channels is not 2 names (found u v w); a name with spaces stands in quotes"),
        ("depth.kind=deep", "depth.kind has no such value (expected planar, ray, inverse, device, device-reversed, "),
        ("motion.units=metres", "motion.units has no such value (expected pixels, uv, ndc, found metres)"),
        ("camera.layout=diagonal", "camera.layout has no such value (expected row, column, found diagonal)"),
        ("camera.sense=x", "camera.sense has no such value (expected world-to-camera, camera-to-world, found x)"),
        ("jitter.source=maybe", "jitter.source has no such value (expected declared, projection, none, found maybe)"),
        ("motion.swap=maybe", "motion.swap has no such value (expected true or false, found maybe)"),
        ("motion.scale=1", "motion.scale has no such value (expected two numbers, found 1)"),
        ("motion.scale=1,nan", "motion.scale has no such value (expected two numbers, found 1,nan)"),
        ("depth.scale=inf", "depth.scale has no such value (expected a number, found inf)"),
        ("depth.sky=high", "depth.sky has no such value (expected a number, found high)"),
        ("motion.jittered=2", "motion.jittered has no such value (expected -1, 0, 1, found 2)"),
        ("depth.scale=0", "depth.scale has no such value (expected no 0, found 0)"),
        ("motion.scale=0,1", "motion.scale has no such value (expected no 0, found 0,1)"),
        ("jitter.scale=1,0", "jitter.scale has no such value (expected no 0, found 1,0)"),
        ("depth.near=-1", "depth.near has no such value (expected a number from 0 on, found -1)"),
        ("camera.near=0", "camera.near has no such value (expected a number above 0, found 0)"),
        ("jitter.delay=100", "jitter.delay has no such value (expected a whole number from -16 to 16, found 100)"),
        ("camera.delay=-17", "camera.delay has no such value (expected a whole number from -16 to 16, found -17)"),
        ("jitter.delay=0.5", "jitter.delay has no such value (expected a whole number from -16 to 16, found 0.5)"),
    ]:
        with pytest.raises(DataError) as caught:
            override(load_profile("cltaa"), [assignment])
        assert message in str(caught.value), assignment
