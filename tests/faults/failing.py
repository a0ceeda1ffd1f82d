"""``python -m tests.faults.failing TOP SHIM WORK ACTION STRIDE``: the n-th call on the output fails, for n = 1, 2, ...

Runs under the preloaded shim (``shim.c``), resolves or captures (WORK) into a fresh folder with the n-th call failing,
checks the invariants, runs the same command again without a fault and checks that every frame has the bits of a run
that met none. Ends with the first n that no run reaches. Prints one line of JSON for each n.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import io
import json
import shutil
import sys
import warnings
from pathlib import Path

from cltaa.cli import main
from tests.faults.runs import WORK, Work, check_after_fault, check_finished
from tests.sequence_factory import digests

ACTIONS = {"once": 1, "from then on": 2}
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS)


def run(command: list[str]) -> tuple[int, str]:
    """Exit code and standard error of one run in this process."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(command)
    return code, said.getvalue()


def prepared(top: Path, work: Work) -> dict[str, str]:
    """Hashes of the images that a run without a fault leaves."""
    work.prepare(top)
    code, said = run(work.command(top, top / "whole"))
    assert code == 0, said
    return digests(top / "whole")


def fail_each_call(top: Path, shim: ctypes.CDLL, work: Work, action: str, stride: int) -> None:
    """Try every ``stride``-th call; every assertion that fails ends the process."""
    whole = prepared(top, work)
    at, output = 1, top / "out"
    while True:
        shutil.rmtree(output, ignore_errors=True)
        shim.fault_arm(str(output).encode(), at, ACTIONS[action], ERRORS[at % len(ERRORS)])
        code, said = run(work.command(top, output))
        reached = shim.fault_calls() >= at
        shim.fault_arm(b"", 0, 0, 0)
        kept = check_after_fault(output, whole)
        assert (code in (73, 74) and str(output) in said) if reached and code else code == 0, (at, code, said)
        again, said_again = run(work.command(top, output))
        assert again == 0, (at, said, said_again)
        check_finished(output, whole, work.records)
        print(json.dumps({"at": at, "reached": reached, "code": code, "kept": kept}), flush=True)
        if not reached:
            return
        at += stride


if __name__ == "__main__":
    warnings.simplefilter("error")
    folder, library, name, how, given = sys.argv[1:]
    fail_each_call(Path(folder), ctypes.CDLL(library), WORK[name], how, int(given))
