"""What a kept measurement depends on: what the files hold, wherever they lie."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.judge.comparison import content_sha256
from tests.sequence_factory import write_images


def test_a_copy_is_measured_alike_and_another_truth_is_not(capture: Path, tmp_path: Path) -> None:
    ours = open_sequence(capture)
    copy = open_sequence(shutil.copytree(capture, tmp_path / "copy"))
    assert content_sha256(copy) == content_sha256(ours)
    elsewhere = open_images(shutil.copytree(capture / "reference", tmp_path / "elsewhere"))
    assert content_sha256(ours, [elsewhere]) != content_sha256(ours)
    write_images(capture / "reference", [image * 2 for image in open_images(capture / "reference")], name="synthetic")
    changed = open_sequence(capture)
    assert content_sha256(changed) != content_sha256(copy)


def test_names_that_are_not_utf_8_tell_measurements_apart_too(capture: Path, tmp_path: Path) -> None:
    kept = set()
    for letter in (b"\xfe", b"\xff", b"a"):
        copy = shutil.copytree(capture, tmp_path / letter.hex())
        for path in copy.rglob("*.exr"):
            path.rename(path.with_name(path.name.replace("synthetic", os.fsdecode(letter))))
        kept.add(content_sha256(open_sequence(copy)))
    assert len(kept) == 3
