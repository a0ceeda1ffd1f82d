"""``cltaa inspect`` of what a resolve wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.frame import Effect
from tests.inputs.foreign import write_blender
from tests.lab.inspect.test_inspect_command import findings, sound, write
from tests.sequence_factory import make_frame


def test_inspect_finds_no_problem_in_resolved_frames(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    effects = frozenset({Effect.CAMERA, Effect.MOTION, Effect.HDR})
    write(tmp_path / "in", [sound(i, effects=effects, motion=True) for i in range(4)])
    command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy", "--preset", "basic"]
    assert main(command) == 0
    capsys.readouterr()
    for more in ([], ["--pixels"]):
        found = findings(capsys, tmp_path / "out", *more, code=0)
        assert (found["resolved_by"], found["problems"], found["idle"]) == ("basic", [], [])
    for command in (
        ["check", str(tmp_path / "out")],
        ["resolve", str(tmp_path / "out"), "-o", str(tmp_path / "twice")],
    ):
        assert main(command) == 64
        said = capsys.readouterr().err
        assert (
            "these are results of cltaa resolve (found preset basic); name the folder that they were made from" in said
        )


def test_what_a_resolve_wrote_beside_the_layers_of_another_tool_is_a_result(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Its own colour is resolved, the layer that it was made from and depth and vectors lie beside it."""
    write_blender(tmp_path / "in", [make_frame(i, motion=True, effects=None) for i in range(3)])
    write(tmp_path / "own", [sound(i) for i in range(3)])
    for folder, options in (("in", []), ("own", ["--layers", "all"])):
        command = ["resolve", str(tmp_path / folder), "-o", str(tmp_path / f"{folder}-out"), "--device", "numpy"]
        assert main([*command, *options]) == 0
        capsys.readouterr()
        for more in ([], ["--pixels"]):
            found = findings(capsys, tmp_path / f"{folder}-out", *more, code=0)
            assert (found["resolved_by"], found["problems"]) == ("default", [])
        profile = [] if folder == "own" else ["--profile", "blender"]
        for command in (
            ["check", str(tmp_path / f"{folder}-out")],
            ["resolve", str(tmp_path / f"{folder}-out"), "-o", str(tmp_path / "twice")],
            ["resolve", str(tmp_path / f"{folder}-out"), "-o", str(tmp_path / "twice"), *profile],
            ["inspect", str(tmp_path / f"{folder}-out"), "--plan", *profile],
        ):
            assert main(command) == 64
            assert "these are results of cltaa resolve (found preset default)" in capsys.readouterr().err
