"""A process that reads many files, so that a crash, a hang or an eaten machine is counted and ends no test run.

``python reading_process.py`` takes one JSON job a line on standard input and answers each with one JSON line:

    {"path": ..., "sha256": ...}                      read that file, compared with that SHA-256 where one is given
    {"path": ..., "seed": n, "numbers": [i, j, k]}   damage the sound file ``path`` in ways range(i, j, k), read each

It prints the number of a damaged file before it reads it: the last one stands there when the process dies.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import re
import signal
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from cltaa.errors import CltaaError
from cltaa.frame import Frame
from cltaa.process import configure
from tests.sequence_factory import read_frame

HANG = 5.0  # seconds of processor time after which reading one small file counts as hanging
STUCK = 60.0  # the same in seconds of the clock: what waits takes no processor time, and a busy machine is slow
IN_THE_HEADER = 2048  # bytes of a file that one damage in ``STEPS`` - ``WINDOWS`` hits
WINDOWS, STEPS = 5000, 8000  # of each round, as OpenEXR's own fuzz test divides it


def damage(content: bytes, seed: int, number: int) -> bytes:
    """Damage a file: a tenth of the bytes of a window that moves through it, then one to three in its first bytes."""
    random = np.random.default_rng((seed, number))
    damaged = np.frombuffer(content, np.uint8).copy()
    step = number % STEPS
    if step < WINDOWS:
        length = max(8, len(damaged) // 50)
        start = step * (len(damaged) - length) // (WINDOWS - 1)
        places = start + random.choice(length, max(1, length // 10), replace=False)
    else:
        places = random.integers(0, min(IN_THE_HEADER, len(damaged)), random.integers(1, 4))
    damaged[places] = random.integers(0, 256, len(places), dtype=np.uint8)
    return damaged.tobytes()


def same(one: Frame, other: Frame, names: tuple[str, ...]) -> bool:
    """Tell whether two frames agree in some of their parts, arrays to the bit."""
    for name in names:
        first, second = getattr(one, name), getattr(other, name)
        if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
            if first.shape != second.shape or first.tobytes() != second.tobytes():
                return False
        elif not (first is None and second is None) and (isinstance(first, np.ndarray) or first != second):
            return False
    return True


PIXELS = ("colour", "depth", "motion", "alpha", "reactive", "object_id", "normal")
HEADER = ("index", "jitter_px", "cut", "exposure", "scene", "effects")


def outcome_of(path: Path, sound: Frame) -> str:
    """What reading a damaged file without a recorded hash came to."""
    try:
        found = read_frame(path)
    except CltaaError:
        return "refused"
    if found.colour.shape != sound.colour.shape:
        return "other size"
    if not same(found, sound, PIXELS):
        return "other pixels"
    cameras = [frame.camera.world_to_view.tobytes() + frame.camera.view_to_clip.tobytes() for frame in (found, sound)]
    return "same" if same(found, sound, HEADER) and cameras[0] == cameras[1] else "other header"


def largest_memory() -> int:
    """kB that this process held at most; ``getrusage`` would begin with what its parent held."""
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1])


def read_damaged(job: dict[str, Any]) -> dict[str, Any]:
    path = Path(job["path"])
    content, sound = path.read_bytes(), read_frame(path)
    digest = hashlib.sha256(content).hexdigest()
    victim = path.with_name(f"damaged.{path.name}")
    counts: Counter[str] = Counter()
    usual = largest_memory()
    for number in range(*job["numbers"]):
        damaged = damage(content, job["seed"], number)
        if damaged == content:
            counts["not damaged"] += 1
            continue
        print(number, flush=True)
        victim.write_bytes(damaged)
        signal.setitimer(signal.ITIMER_PROF, HANG)  # ends the process
        faulthandler.dump_traceback_later(STUCK, exit=True)
        counts[outcome_of(victim, sound)] += 1
        try:
            read_frame(victim, sha256=digest)
            counts["passed its hash"] += 1
        except CltaaError:
            counts["stopped by its hash"] += 1
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_PROF, 0)
    peak = largest_memory()
    return {"counts": dict(counts), "usual": usual, "peak": peak}


def read_one(job: dict[str, Any]) -> dict[str, Any]:
    begin = time.process_time()
    try:
        frame = read_frame(Path(job["path"]), sha256=job.get("sha256"))
        pixels = hashlib.sha256(frame.colour.tobytes() + frame.depth.tobytes()).hexdigest()
        answer: dict[str, Any] = {"code": 0, "message": "", "pixels": pixels}
    except CltaaError as error:
        answer = {"code": error.exit_code, "message": str(error)}
    peak = largest_memory()
    return answer | {"path": job["path"], "seconds": time.process_time() - begin, "peak": peak}


if __name__ == "__main__":
    configure()  # what OpenEXR prints would stand among the answers
    for line in sys.stdin:
        task = json.loads(line)
        print(json.dumps(read_damaged(task) if "seed" in task else read_one(task)), flush=True)
