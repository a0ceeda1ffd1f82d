"""``python -m tests.faults.small_files TOP STEPS``: no file may grow beyond k bytes (RLIMIT_FSIZE), for STEPS k.

In a process of its own, because the limit would also bind the tests that follow. Prints one line of JSON for each k.
"""

from __future__ import annotations

import json
import resource
import shutil
import sys
import warnings
from pathlib import Path

from tests.faults.failing import prepared, run
from tests.faults.runs import WORK, check_after_fault, check_finished

LARGEST = 24_000  # bytes: more than an image, the manifest and a checkpoint of this size take


def limit_each_size(top: Path, steps: int) -> None:
    """Every assertion that fails ends the process."""
    work = WORK["resolve"]
    whole = prepared(top, work)
    output, (_, hard) = top / "out", resource.getrlimit(resource.RLIMIT_FSIZE)
    for step in range(steps):
        shutil.rmtree(output, ignore_errors=True)
        most = LARGEST * step // (steps - 1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
        code, said = run(work.command(top, output))
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        kept = check_after_fault(output, whole)
        assert code == 0 or (code in (73, 74) and str(output) in said), (most, code, said)
        again, said_again = run(work.command(top, output))
        assert again == 0, (most, said, said_again)
        check_finished(output, whole)
        print(json.dumps({"most": most, "code": code, "kept": kept}), flush=True)


if __name__ == "__main__":
    warnings.simplefilter("error")
    limit_each_size(Path(sys.argv[1]), int(sys.argv[2]))
