"""Files whose hashes were recorded are verified when they are read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cltaa.errors import DataError
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.io.manifest import Entry, Manifest, file_sha256
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.check.report import check_folder
from cltaa.lab.inspect.findings import describe_input, inspect_folder
from tests.sequence_factory import write_sequence


def record(folder: Path, *names: str) -> None:
    """Write ``sequence.json`` as a capture does."""
    digests = {name: file_sha256(folder / name) for name in names}
    (folder / "sequence.json").write_text(json.dumps({"format": 1, "files": digests}))


def change_a_pixel(path: Path) -> None:
    """A file that is sound in itself, with another picture."""
    channels, header = read_image(path)
    channels["R"] = channels["R"].copy()
    channels["R"][3, 4] += 1
    write_image(path, channels, header)


def test_recorded_hash_is_verified(tmp_path: Path) -> None:
    write_sequence(tmp_path, 3)
    record(tmp_path, "synthetic.0000.exr", "synthetic.0001.exr")
    assert len(list(open_sequence(tmp_path))) == 3  # the last is not recorded, which is no error
    change_a_pixel(tmp_path / "synthetic.0001.exr")
    sequence = open_sequence(tmp_path)
    sequence.frame(0), sequence.frame(2)
    with pytest.raises(DataError, match=r"synthetic\.0001\.exr: the content is not what was recorded .*SHA-256"):
        sequence.frame(1)
    with pytest.raises(DataError, match="not what was recorded"):
        open_images(tmp_path / "synthetic.0001.exr").image(1)
    assert open_sequence(tmp_path, verify=False).select(1, 2).frame(1).colour[3, 4, 0] > 1


def test_files_of_several_folders_are_verified_by_the_record_of_each(tmp_path: Path) -> None:
    for number in range(2):
        folder = write_sequence(tmp_path / f"part{number}", 1, first=number)
        record(folder, f"synthetic.{number:04d}.exr")
    named = tmp_path / "part*" / "synthetic.####.exr"
    assert len(list(open_sequence(named))) == 2
    change_a_pixel(tmp_path / "part1" / "synthetic.0001.exr")
    for read in (open_sequence(named).frame, open_images(named).image):
        with pytest.raises(DataError, match=r"synthetic\.0001\.exr: the content is not what was recorded"):
            read(1)
    problems = inspect_folder(named, pixels=True).problems
    assert any("synthetic.0001.exr: the content is not what was recorded" in problem for problem in problems), problems


def test_check_and_inspect_list_a_file_that_is_not_what_was_recorded(tmp_path: Path) -> None:
    write_sequence(tmp_path, 2)
    record(tmp_path, "synthetic.0000.exr", "synthetic.0001.exr")
    change_a_pixel(tmp_path / "synthetic.0001.exr")
    report, _ = check_folder(tmp_path)
    (problem,) = describe_input(tmp_path, profile="cltaa", pixels=True).problems
    for told in (report.findings[0].what, problem):
        assert "synthetic.0001.exr: the content is not what was recorded" in told


def test_reference_is_verified_by_the_record_of_its_capture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(tmp_path, 2, reference=True)
    record(tmp_path, "reference/synthetic.0000.exr", "reference/synthetic.0001.exr")
    change_a_pixel(tmp_path / "reference" / "synthetic.0001.exr")
    monkeypatch.chdir(tmp_path / "reference")
    for images in (open_sequence(tmp_path).reference, open_images(".")):
        assert images is not None
        images.image(0)
        with pytest.raises(DataError, match="not what was recorded"):
            images.image(1)
    reference = open_sequence(tmp_path, verify=False).reference
    assert reference is not None
    reference.image(1)


def test_resolved_images_are_verified_by_their_manifest(tmp_path: Path) -> None:
    write_sequence(tmp_path, 1)
    path = tmp_path / "synthetic.0000.exr"
    manifest = Manifest(tmp_path)
    manifest.begin({})
    manifest.append(path.name, Entry(file_sha256(path), "", None))
    open_images(tmp_path).image(0)
    change_a_pixel(path)
    with pytest.raises(DataError, match="not what was recorded"):
        open_images(tmp_path).image(0)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ('{"files": {"synthetic.0000.exr": 5}}', "wrong content .*a SHA-256 in hexadecimal"),
        ('{"files": ["a"]}', "wrong content .*a SHA-256 in hexadecimal"),
        ('{"files": "abc"}', "wrong content .*a SHA-256 in hexadecimal"),
        ("[" * 100_000, "not readable as JSON: .*; capture the sequence again"),
        ("{", "not readable as JSON: "),
        ("\udcff", "not UTF-8"),
        ("7", "wrong content .*a JSON object, found int"),
    ],
)
def test_damaged_record_is_an_error_and_not_a_pass(tmp_path: Path, content: str, says: str) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 1))
    (tmp_path / "sequence.json").write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(DataError, match=rf"sequence\.json: {says}"):
        sequence.frame(0)
