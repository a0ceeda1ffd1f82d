"""What a stranger's files can do: be refused, or be read. SECURITY.md says what is promised."""

from __future__ import annotations

import ast
import base64
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, InputMissing
from cltaa.io.exr_frame import frame_attributes
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.io.manifest import LARGEST_RECORD
from cltaa.io.sequence import open_sequence
from cltaa.printable import printable
from cltaa_datasets.gltf_file import GltfFile
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, read_frame, write_sequence
from tests.test_architecture import imported, sources

ESCAPES = "\x1b[2J\x1b]0;title\x07\x1bc\r\b\x9b31m\u202e"


def hostile_sequence(folder: Path, text: str, count: int = 2) -> Path:
    """A sequence whose every text attribute, known and unknown, is ``text``."""
    folder.mkdir(parents=True)
    for index in range(count):
        header = frame_attributes(make_frame(index)) | dict.fromkeys(("cltaa:scene", "owner", "comments", "name"), text)
        planes = {name: np.ones((HEIGHT, WIDTH), np.float32) for name in "RGBZ"}
        write_image(folder / f"a.{index:04d}.exr", planes, header)
    return folder


def files_in(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.parametrize("text", ["../../escaped", "/tmp/escaped", "$(touch escaped)"])
def test_attributes_name_no_file_and_no_command(tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home"
    folder = hostile_sequence(home / "in", text)
    monkeypatch.chdir(home)
    command = [
        "resolve",
        str(folder),
        "-o",
        str(home / "out"),
        "--device",
        "numpy",
        "--preview",
        str(home / "film.mp4"),
    ]
    assert main(command) == 0
    assert main(["inspect", str(folder), "--pixels"]) in (0, 65)
    assert files_in(tmp_path) == {
        "home",
        "home/in",
        "home/in/a.0000.exr",
        "home/in/a.0001.exr",
        "home/film.mp4",
        "home/out",
        *(f"home/out/{path.name}" for path in (home / "out").iterdir()),
    }
    assert {path.suffix for path in (home / "out").iterdir()} <= {".exr", ".json", ".jsonl", ".lock"}
    _, header = read_image(home / "out" / "a.0001.exr")
    assert header["cltaa:scene"] == text  # kept, and used for nothing


def test_record_that_names_files_elsewhere(tmp_path: Path) -> None:
    """Hashes are looked up by the names of files that are there; a name in the record opens nothing."""
    write_sequence(tmp_path / "in", 1)
    names = ("../secret", "/etc/passwd", "reference/../../secret", "")
    record = {"files": dict.fromkeys(names, "0" * 64), "frames": 10**9, "scene": "../x"}
    (tmp_path / "in" / "sequence.json").write_text(json.dumps(record))
    assert len(list(open_sequence(tmp_path / "in"))) == 1


@pytest.mark.parametrize("command", ["inspect", "compare", "resolve"])
def test_no_escape_sequence_reaches_the_terminal(
    tmp_path: Path, command: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """From a folder, a file name, an attribute, or the words of an error about them."""
    folder = hostile_sequence(tmp_path / ESCAPES, ESCAPES)
    (folder / f"{ESCAPES}.exr").write_bytes(b"x")
    extra = {"inspect": [], "compare": [str(folder)], "resolve": ["-o", str(tmp_path / f"out{ESCAPES}")]}[command]
    for _ in range(2):  # first an error about the odd file, then a sound run
        main([command, str(folder), *extra])
        said = capfd.readouterr()
        assert said.out + said.err
        for text in (said.out, said.err):
            assert text.replace("\n", "").isprintable()
        (folder / f"{ESCAPES}.exr").unlink(missing_ok=True)


def test_unprintable_characters_are_escaped() -> None:
    assert printable("plain ünïcode 映画 🎬") == "plain ünïcode 映画 🎬"
    assert printable(ESCAPES + "\n\udcff") == r"\x1b[2J\x1b]0;title\x07\x1bc\r\x08\x9b31m\u202e\n\udcff"
    assert printable("x" * 1000, longest=100) == "x" * 47 + " ... " + "x" * 47


BANNED_CALLS = {"os.system", "os.popen", "eval", "exec", "subprocess.getoutput", "subprocess.getstatusoutput"}
LAST_WORDS = {name.rpartition(".")[2] for name in BANNED_CALLS} | {"load"}  # few calls are looked at any closer
BANNED_MODULES = {"pickle", "marshal", "shelve", "socket", "urllib.request", "requests"}


def dangers(tree: ast.AST) -> Iterator[str]:
    """What runs a shell, unpacks code or asks a network."""
    for node in ast.walk(tree):
        last = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
        if isinstance(node, ast.Call) and (last in LAST_WORDS or any(word.arg == "shell" for word in node.keywords)):
            called, given = ast.unparse(node.func), {word.arg: ast.unparse(word.value) for word in node.keywords}
            unsafe_load = called == "np.load" and given.get("allow_pickle") != "False"
            if called in BANNED_CALLS or given.get("shell", "False") != "False" or unsafe_load:
                yield ast.unparse(node)
    yield from BANNED_MODULES & {*imported(tree)}


def test_nothing_runs_a_shell_or_unpacks_code() -> None:
    """No shell, no eval, no pickle, no download: only lists of arguments, JSON, TOML and arrays without objects.

    A Dask cluster that the user names is sent objects as Dask sends all, and no file says which.
    """
    found = [f"{module}: {danger}" for module, tree in sources().items() for danger in dangers(tree)]
    assert found == ["cltaa.pipeline.cluster: pickle"]


def test_a_planted_danger_is_seen() -> None:
    for line in [
        "os.system('x')",
        "eval('x')",
        "subprocess.run('x', shell=True)",
        "np.load('x')",
        "import pickle",
        "from urllib import request",
    ]:
        assert len([*dangers(ast.parse(line))]) == 1, line


@pytest.mark.parametrize("name", ["sequence.json", "manifest.jsonl"])
def test_pipe_in_place_of_a_record_makes_nobody_wait(tmp_path: Path, name: str) -> None:
    write_sequence(tmp_path, 1)
    os.mkfifo(tmp_path / name)
    with pytest.raises(DataError, match=f"{name}: this is a pipe or a device"):
        open_sequence(tmp_path).frame(0)


def test_device_in_place_of_a_frame_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.0000.exr").symlink_to("/dev/zero")
    with pytest.raises(DataError, match="pipe or a device"):
        read_frame(tmp_path / "a.0000.exr")


def test_file_that_is_cut_short_while_it_is_read(tmp_path: Path) -> None:
    """A mapped file would end the process with SIGBUS; a read one is an error, or was read before the cut."""
    write_sequence(tmp_path, 1, width=256, height=256)
    path = tmp_path / "synthetic.0000.exr"
    code = (
        "import os, sys, threading\nfrom pathlib import Path\nfrom cltaa.errors import CltaaError\n"
        "from cltaa.io.exr_read import read_image\n"
        "path = Path(sys.argv[1])\ncontent = path.read_bytes()\ndone = False\n"
        "def cut():\n    while not done:\n        os.truncate(path, 1000)\n        path.write_bytes(content)\n"
        "thread = threading.Thread(target=cut)\nthread.start()\n"
        "for _ in range(200):\n    try:\n        read_image(path)\n    except CltaaError:\n        pass\n"
        "done = True\nthread.join()\n"
    )
    child = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr


def test_a_record_of_any_size_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 1)
    record = tmp_path / "in" / "sequence.json"
    record.write_text("{}")
    os.truncate(record, LARGEST_RECORD + 1)
    with pytest.raises(DataError, match="too large for a record"):
        open_sequence(tmp_path / "in").frame(0)


def write_model(path: Path, uri: str) -> Path:
    content = {"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 8}]}
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "%2e%2e/secret.bin", "/etc/passwd", "sub/../../secret.bin", "link.bin"]
)
def test_model_reads_nothing_outside_its_folder(tmp_path: Path, uri: str) -> None:
    (tmp_path / "secret.bin").write_bytes(b"12345678")
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "link.bin").symlink_to("../secret.bin")
    with pytest.raises(DataError, match="outside its own folder"):
        GltfFile(write_model(tmp_path / "model" / "a.gltf", uri))


@pytest.mark.parametrize("uri", ["http://localhost/x.bin", "file:///etc/passwd", "\x1b[2J"])
def test_model_fetches_nothing(tmp_path: Path, uri: str) -> None:
    with pytest.raises(InputMissing, match="beside the model"):
        GltfFile(write_model(tmp_path / "a.gltf", uri))


def test_model_beside_its_buffer_is_read(tmp_path: Path) -> None:
    (tmp_path / "a b.bin").write_bytes(b"12345678")
    for uri in ("a%20b.bin", "data:;base64," + base64.b64encode(b"12345678").decode()):
        assert GltfFile(write_model(tmp_path / "a.gltf", uri)).json["asset"]["version"] == "2.0"
