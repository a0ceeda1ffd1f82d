"""``sequence.json``: the arguments of a capture, the versions that drew it, and a SHA-256 for every finished file.

It is written before the first frame and again as frames finish. A frame that it does not list is drawn again, with the
same bits, so that a capture may be killed at any moment.
"""

from __future__ import annotations

import ast
import hashlib
import json
import platform
import time
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from cltaa import __version__
from cltaa.errors import CltaaError, DataError, UsageError
from cltaa.io.atomic import atomic_path, make_folder, remove_stale_temporaries
from cltaa.io.content import read_text
from cltaa.io.manifest import CAPTURE, LARGEST_RECORD, RESTART_CURE, begun_otherwise, file_sha256

REFERENCE = "reference"
FORMAT = 1
LIBRARIES = ("numpy", "OpenEXR", "pyrender", "PyOpenGL", "trimesh", "scipy", "Pillow")
SAVE_EVERY = 1.0  # seconds; between saves; a kill also loses the files in work
SHADER_SUFFIXES = (".vert", ".frag", ".glsl")
# Modules that draw nothing of a capture.
NOT_DRAWING = (
    "cltaa_capture/cli.py",
    "cltaa_capture/manifest.py",
    "cltaa_datasets/cli.py",
    "cltaa_datasets/ray_cast.py",
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


@cache
def code_sha256() -> str:
    """Return the SHA-256 of the drawing code and shaders of capture and scenes, because other code may draw other
    pixels; comments, docstrings, white space and the descriptions of scenes do not count."""
    digest = hashlib.sha256()
    for package in ("cltaa_capture", "cltaa_datasets"):
        for name, content in sorted(_code_files(files(package), package)):
            digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _code_files(folder: Traversable, prefix: str) -> list[tuple[str, bytes]]:
    found = []
    for entry in folder.iterdir():
        name = f"{prefix}/{entry.name}"
        if entry.is_dir():
            found += _code_files(entry, name)
        elif entry.name.endswith(SHADER_SUFFIXES):
            found.append((name, entry.read_bytes()))
        elif entry.name.endswith(".py") and name not in NOT_DRAWING:
            found.append((name, what_runs(entry.read_text(encoding="utf-8"))))
    return found


def what_runs(source: str) -> bytes:
    """Return Python source without comments, docstrings, white space and descriptions of scenes; equal in every version
    of Python."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "register":
            del node.args[1:2]  # its description
        if isinstance(node, ast.JoinedStr):  # 3.12 adds an empty constant after a computed width
            node.values = [part for part in node.values if not isinstance(part, ast.Constant) or part.value != ""]
    return _written(tree).encode()


def _written(node: object) -> str:
    """Return a syntax tree as text without empty fields, which ``ast.dump`` shows differently in each version."""
    if isinstance(node, list):
        return f"[{', '.join(map(_written, node))}]"
    if not isinstance(node, ast.AST):
        return ascii(node)
    fields = ((name, getattr(node, name, None)) for name in node._fields)
    told = (f"{name}={_written(value)}" for name, value in fields if value is not None and value != [])
    return f"{type(node).__name__}({', '.join(told)})"


def versions(opengl: str) -> dict[str, str]:
    """Return the versions of the software that draws and writes; ``opengl`` is the driver's own description."""
    ours = {"python": platform.python_version(), "opengl": opengl, "cltaa": __version__}
    return ours | {name: version(name) for name in LIBRARIES}


def _names_in(path: Path) -> set[str] | None:
    """Return the names of frames that a manifest lists, or that its capture had still to draw, because a kill leaves
    some unlisted; None without a manifest that can be read."""
    try:
        content = json.loads(read_text(path, "a record", LARGEST_RECORD))
        drawn = {frame_name(content["scene"], index) for index in range(content["frames"])}
        return drawn | {Path(name).name for name in content["files"]}
    except (CltaaError, ValueError, KeyError, TypeError, RecursionError):
        return None


def frame_name(scene: str, index: int) -> str:
    """Return the file name of a frame, and of its truth."""
    return f"{scene}.{index:04d}.exr"


class Manifest:
    """The finished files of one capture folder."""

    def __init__(self, folder: Path, settings: dict[str, Any], facts: dict[str, Any], *, restart: bool = False) -> None:
        """Open or begin the manifest of ``folder``, which this process must own (``cltaa.io.atomic.owned``).

        ``settings`` decide the pixels: raises UsageError with the difference for a folder begun with others, unless
        ``restart``, which deletes the frames that the folder's manifest names. ``facts`` are only recorded.
        Raises OutputError for a folder that cannot be made, DataError for a damaged manifest.
        """
        self._folder, self._settings, self._facts = make_folder(folder), settings, facts
        self._files: dict[str, str] = {}
        self._seconds: dict[str, float] = {}  # by samples a pixel
        self._saved = float("-inf")
        found = folder / CAPTURE
        begun = _names_in(found) if restart else None
        if begun is not None:
            self._clear(begun)
        elif found.exists() and not restart:
            self._resume(found)
        elif any(folder.glob("*.exr")):
            what, cure = "holds EXR files of another origin", "choose an empty folder"
            raise UsageError(what, path=folder, expected=CAPTURE, cure=cure)
        for inside in self._folders():
            remove_stale_temporaries(inside)
        self.save()

    def _folders(self) -> list[Path]:
        """Return the folder itself, then its existing reference folders."""
        truths = (self._folder / REFERENCE, *self._folder.glob(f"{REFERENCE}-[0-9]*"))
        return [self._folder, *(truth for truth in truths if truth.is_dir())]

    def _resume(self, path: Path) -> None:
        text = read_text(path, "a record", LARGEST_RECORD)
        try:
            content = json.loads(text)
            settings, files_, seconds = content["settings"], content["files"], dict(content.get("seconds_a_frame", {}))
            # A kill may have left unlisted frames beyond those that this run asks for.
            frames = max(self._facts["frames"], content["frames"])
            if content["format"] != FORMAT or not isinstance(settings, dict) or not isinstance(files_, dict):
                raise ValueError("not of this format")
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            what, cure = f"cannot be resumed from ({error})", "use --restart to begin anew"
            raise DataError(what, path=path, cure=cure) from error
        for key in dict.fromkeys([*self._settings, *settings]):  # requested settings first, beginning with the scene
            asked, begun = self._settings.get(key), settings.get(key)
            if asked != begun:
                if key == "code_sha256":  # 64 digits would not help a reader
                    what = "was begun by another version of capture or scenes, which may draw other pixels"
                    raise UsageError(what, path=path, cure=RESTART_CURE)
                if key == "model_sha256":
                    raise UsageError("was begun with another content of the model", path=path, cure=RESTART_CURE)
                if key in ("scene", "opengl"):  # no options
                    what = f"was begun with another {key.replace('opengl', 'OpenGL')}"
                    raise UsageError(what, path=path, expected=asked, found=begun, cure=RESTART_CURE)
                if key in ("width", "height"):
                    key = "size"
                    begun, asked = (f"{its.get('width')}x{its.get('height')}" for its in (settings, self._settings))
                raise begun_otherwise(path, f"--{key}", begun, asked)
        self._files, self._seconds = files_, seconds
        self._facts |= {"frames": frames}

    def _clear(self, names: set[str]) -> None:
        """Delete the frames with these names, in the folder itself or as a truth, and at last the manifest."""
        for folder in self._folders():
            for path in folder.glob("*.exr"):
                if path.name in names:
                    path.unlink()
            # An empty reference folder would look like a truth.
            if folder != self._folder:
                with suppress(OSError):
                    folder.rmdir()
        (self._folder / CAPTURE).unlink()

    def has_finished(self, path: Path) -> bool:
        """Return whether a file is finished: listed, with the listed SHA-256."""
        expected = self._files.get(self._key(path))
        return expected is not None and path.is_file() and file_sha256(path) == expected

    def add(self, path: Path, digest: str) -> None:
        """List a finished file; the manifest on disk follows at most ``SAVE_EVERY`` seconds later."""
        self._files[self._key(path)] = digest
        if time.monotonic() - self._saved >= SAVE_EVERY:
            self.save()

    def note_seconds(self, samples: int, seconds: float) -> None:
        """Record the median time of drawing a frame with this many samples a pixel, including read-back."""
        self._seconds[str(samples)] = round(seconds, 6)

    def save(self) -> None:
        """Write the manifest, atomically; raises OutputError and StorageError."""
        content = {
            "format": FORMAT,
            **self._facts,
            "seconds_a_frame": dict(sorted(self._seconds.items(), key=lambda item: int(item[0]))),
            "settings": self._settings,
            "files": dict(sorted(self._files.items())),
        }
        with atomic_path(self._folder / CAPTURE) as temporary:
            temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        self._saved = time.monotonic()

    def _key(self, path: Path) -> str:
        return path.relative_to(self._folder).as_posix()
