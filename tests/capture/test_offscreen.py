"""Where OpenGL's libraries are looked for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

# Without EGL's functions PyOpenGL does not bind to it; those of GL it asks for one by one.
SCRIPT = """
from cltaa_capture import offscreen
offscreen.choose_egl()
offscreen._mend_loader()
from OpenGL import platform
print(platform.PLATFORM.GL._name, hasattr(platform.PLATFORM.GL, "planted"))
"""


def test_a_library_that_only_the_linkers_path_knows_is_found(tmp_path: Path) -> None:
    library = tmp_path / "libGL.so.1"
    source = "int planted;"
    subprocess.run(["gcc", "-shared", "-fPIC", "-x", "c", "-o", str(library), "-"], input=source, text=True, check=True)
    others = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"}
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("LD_LIBRARY_PATH")])])
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**others, "LD_LIBRARY_PATH": path, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    assert run.stdout.split() == ["libGL.so.1", "True"]


def test_python_without_assertions_is_refused_because_nothing_can_be_drawn() -> None:
    """Not that a library is missing, which it is not."""
    run = subprocess.run(
        [sys.executable, "-O", "-c", "from cltaa_capture.offscreen import open_context; open_context()"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert "without python -O and without the variable PYTHONOPTIMIZE" in run.stderr
