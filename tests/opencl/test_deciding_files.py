"""The hash of the code that decides a result covers what a resolve loads."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from cltaa.core.kernel_source import deciding_files

# Everything that cltaa resolve may load to make a frame: of own files, of other tools', on a device and by NumPy.
LOADED = """
import sys
import cltaa.pipeline.run, cltaa.core.bands, cltaa.inputs.foreign, cltaa.inputs.open
import cltaa.opencl.program, cltaa.reference
print(*(module.__file__ for name, module in sys.modules.items() if name.split(".")[0] == "cltaa"), sep="\\n")
"""


def test_all_that_a_resolve_loads_is_hashed() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    loaded = {Path(line) for line in done.stdout.split()}
    assert len(loaded) > 50
    assert loaded - set(deciding_files()) == set()


def test_every_kernel_is_hashed() -> None:
    names = {path.name for path in deciding_files()}
    assert {"resolve.cl", "gather.cl", "blend.h"} <= names
