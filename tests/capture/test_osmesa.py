"""Where OpenGL's libraries are looked for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

# What PyOpenGL asks an OSMesa for when it binds to it.
STUB = "void *OSMesaGetCurrentContext(void) { return 0; } void *OSMesaGetProcAddress(const char *name) { return 0; }"
SCRIPT = """
from cltaa_capture import osmesa
assert osmesa.choose_backend("osmesa") == "osmesa"
osmesa._mend_loader()
from OpenGL import platform
print(platform.PLATFORM.GL._name, hasattr(platform.PLATFORM.GL, "planted"))
"""


def test_a_library_that_only_the_linkers_path_knows_is_found(tmp_path: Path) -> None:
    library = tmp_path / "libOSMesa.so.8"
    source = STUB + " int planted;"
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
    assert run.stdout.split() == ["libOSMesa.so.8", "True"]


def test_python_without_assertions_is_refused_because_nothing_can_be_drawn() -> None:
    """Not that a library is missing, which it is not."""
    run = subprocess.run(
        [sys.executable, "-O", "-c", "from cltaa_capture.osmesa import open_context; open_context()"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert "without python -O and without the variable PYTHONOPTIMIZE" in run.stderr
