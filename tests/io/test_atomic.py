"""Files appear whole or not at all, and what killed writers left behind is found."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cltaa.errors import OutputError, StorageError
from cltaa.io.atomic import atomic_path, make_folder, move_into, remove_stale_temporaries, temporary_folder


def test_the_file_is_flushed_then_renamed_then_its_folder_flushed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """File flushed, then renamed, then folder flushed: any other order can lose the file when the machine stops."""
    steps = []
    real_fsync, real_replace = os.fsync, Path.replace

    def fsync(descriptor: int) -> None:
        steps.append("flush " + Path(f"/proc/self/fd/{descriptor}").resolve().name)
        real_fsync(descriptor)

    def replace(self: Path, target: Path) -> Path:
        steps.append("rename")
        return real_replace(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    with atomic_path(tmp_path / "a.txt") as temporary:
        assert temporary.parent == tmp_path
        temporary.write_text("whole")
        assert not (tmp_path / "a.txt").exists()
    assert steps == [f"flush {temporary.name}", "rename", f"flush {tmp_path.name}"]
    assert (tmp_path / "a.txt").read_text() == "whole"


def test_exception_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["pipe", "link", "/", "."])
def test_what_is_no_file_stays(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in the place of /dev/null would grow with whatever anybody writes there."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("link").symlink_to("pipe")
    before = Path(name).lstat()
    with pytest.raises(OutputError, match=r"this is a (pipe or a device|folder)"), atomic_path(Path(name)):
        pass
    assert Path(name).lstat().st_ino == before.st_ino


def test_disk_errors(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="this is a folder"), atomic_path(tmp_path / "folder"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be created"):
        make_folder(tmp_path / "file" / "below")
    assert make_folder(tmp_path / "a" / "b").is_dir()


def test_what_killed_writers_left_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with atomic_path(path) as temporary:
        temporary.touch()
        killed = temporary.rename(f"{temporary}0")  # as of another process
        temporary.touch()
    (tmp_path / ".hidden").touch()
    remove_stale_temporaries(tmp_path)
    assert not killed.exists()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [".hidden", "a.txt"]


def test_nobody_writes_into_a_temporary_folder_that_is_gone(tmp_path: Path) -> None:
    with temporary_folder(tmp_path) as place:
        for name in ("one", "two"):
            with atomic_path(place / name) as path:
                path.write_text(name)
        move_into(place / "one", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["one"]
    with pytest.raises(OutputError, match="cannot be created"), atomic_path(place / "three"):
        pass
    with pytest.raises(StorageError, match=r"two: moving it to .* failed: No such file or directory"):
        move_into(place / "two", tmp_path)


def test_a_stale_folder_is_deleted_and_not_what_a_link_leads_to(tmp_path: Path) -> None:
    outside, inside = tmp_path / "outside", make_folder(tmp_path / "inside")
    for folder in (outside, inside / ".1f.tmp.7"):
        (make_folder(folder) / "frame").touch()
    (inside / ".2f.tmp.7").symlink_to(outside)
    remove_stale_temporaries(inside)
    assert [*inside.iterdir()] == []
    assert (outside / "frame").exists()
