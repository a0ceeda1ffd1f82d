"""What a kept measurement depends on: what the files hold, wherever they lie."""

from __future__ import annotations

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
