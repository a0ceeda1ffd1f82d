"""The faults of ``mutations.toml`` put in one at a time, to see that the tests notice: ``sh scripts/mutate``.

Each is a small change of a file, made in a copy of the tree. Two selections of tests then run on the copy: those that
compare bits (the golden vectors, the twins), and those that look at values alone (bounds, failure modes). Every fault
must be noticed by one of them; where its text is no longer found exactly once, or the kernel no longer builds, the run
fails.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).parents[2]
# The quickest first: the first failure ends a run.
BITS = [
    "tests/numerics/test_golden.py",
    "tests/kernels/test_twins.py::test_a_stage_gives_the_bits_of_its_twin",
    "tests/kernels/test_twins.py::test_a_reset_uses_no_history_and_gives_the_bits_of_the_twin",
    "tests/kernels/test_twins.py::test_edges_are_extended_as_the_twin_extends_them",
    "tests/kernels/test_twins.py::test_a_kernel_writes_its_pixels_and_at_most_the_rest_of_a_segment",
    "tests/kernels/test_twins.py::test_a_stage_gives_the_bits_of_its_twin_for_many_choices",
    "tests/kernels/test_resolve.py::test_same_bits_for_every_storage",
]
# What the table calls ``bound of KERNEL-CHOICE``, ``twin of KERNEL-CHOICE`` and so on; gpu is a program of one lane.
TESTS = {
    "bound": "tests/numerics/test_bounds.py::test_a_fast_kernel_lies_inside_its_bound_and_near_it",
    "gpu bound": "tests/numerics/test_bounds.py::test_every_choice_of_a_gpu_lies_inside_its_bound",
    "twin": "tests/kernels/test_twins.py::test_a_stage_gives_the_bits_of_its_twin_for_every_choice",
    "gpu twin": "tests/kernels/test_twins.py::test_one_lane_gives_the_bits_of_the_twin_for_every_choice",
}
SECONDS = 900  # of one selection


class Mutation(NamedTuple):
    """A fault: in ``file`` the text ``right`` is replaced by ``wrong``."""

    fault: str
    file: str
    right: str
    wrong: str
    values: tuple[str, ...] = ()  # tests that need no twin and should notice

    bits: tuple[str, ...] = ()  # tests of bits to ask before all the others

    def selection(self, kind: str) -> list[str]:
        """``values`` or ``bits`` as pytest takes them."""
        wanted: tuple[str, ...] = getattr(self, kind)
        return [re.sub("^([a-z ]+) of (.*)", lambda name: f"{TESTS[name[1]]}[{name[2]}]", test) for test in wanted]


TABLE = Path(__file__).with_suffix(".toml")
MUTATIONS = [Mutation(**row) for row in tomllib.loads(TABLE.read_text(encoding="utf-8"))["mutation"]]


def occurrences(mutation: Mutation, top: Path = TOP) -> int:
    """How often the text that a mutation replaces stands in its file."""
    return (top / mutation.file).read_text(encoding="utf-8").count(mutation.right)


def copy_tree(to: Path) -> None:
    """Copy what git knows or would add."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=TOP,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (TOP / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, to / name)


class Ended(NamedTuple):
    """How pytest ended: its exit code (None: it was stopped), what it said, and the first test that failed, if any."""

    code: int | None
    said: str
    failed: str


def run_tests(tree: Path, arguments: Sequence[str], patience: float | None, cache: str, **settings: str) -> Ended:
    """Run pytest on a copy of the tree until a test fails, or for ``patience`` seconds; kernels with faults stay out of
    the ``cache`` that other programs use."""
    paths = os.pathsep.join(str(tree / name) for name in ("", "capture", "datasets_gen"))
    settings |= {"PYTHONPATH": paths, "POCL_CACHE_DIR": str(tree.with_name(cache))}
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments],
        cwd=tree,
        env={**os.environ, **settings},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return Ended(None, "", "")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+?(?:\[.*?\])?)(?: - |$)", said, re.MULTILINE)
    return Ended(process.returncode, said, failed[1] if failed else "")


def noticed_by(tree: Path, selection: list[str]) -> str:
    """The first test that fails in a tree, or nothing; raises SystemExit where a kernel does not build."""
    if not selection:
        return ""
    heavy = ["-m", ""] if all("::" in test for test in selection) else []  # single tests, however heavy
    run = run_tests(tree, [*heavy, *selection], SECONDS, f"{tree.name}-cache")
    if run.code is None:
        return f"no end within {SECONDS} s"
    if "does not build" in run.said:
        raise SystemExit(f"the kernel does not build:\n{run.said[-2000:]}")
    if run.code and not run.failed:
        raise SystemExit(f"pytest ended with {run.code}:\n{run.said[-2000:]}")
    return run.failed.removeprefix("tests/")


def results(chosen: list[Mutation]) -> Iterator[tuple[Mutation, str, str]]:
    """Each mutation with what noticed it among the tests of bits and among those of values."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        copy_tree(tree)
        already = noticed_by(
            tree, BITS + sorted({test for mutation in chosen for test in mutation.selection("values")})
        )
        if already:
            raise SystemExit(f"fails without any mutation: {already}")
        for mutation in chosen:
            file = tree / mutation.file
            text = file.read_text(encoding="utf-8")
            file.write_text(text.replace(mutation.right, mutation.wrong), encoding="utf-8")
            first, values = (mutation.selection(kind) for kind in ("bits", "values"))
            bits = noticed_by(tree, first) or noticed_by(tree, BITS)
            yield mutation, bits, noticed_by(tree, values)
            file.write_text(text, encoding="utf-8")


def chosen_by(parts: Sequence[str]) -> list[Mutation]:
    """The faults whose description holds one of ``parts``, or whose file is meant by it; all of them without any.

    Raises SystemExit for parts that choose nothing.
    """
    names = {part: Path(part).resolve().relative_to(TOP).as_posix() for part in parts if _is_in_tree(part)}

    def is_meant(mutation: Mutation, part: str) -> bool:
        return part in mutation.fault or part in mutation.file or mutation.file == names.get(part)

    idle = [part for part in parts if not any(is_meant(mutation, part) for mutation in MUTATIONS)]
    if idle:
        raise SystemExit(f"no fault and no file of one holds {', '.join(idle)}; see --list")
    return [mutation for mutation in MUTATIONS if not parts or any(is_meant(mutation, part) for part in parts)]


def _is_in_tree(part: str) -> bool:
    return Path(part).resolve().is_relative_to(TOP)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table; exit with 1 where a mutation lives."""
    parser = argparse.ArgumentParser(prog="scripts/mutate", description=__doc__)
    told = "only faults whose description or file holds one of these texts (resolve.h, kernels/resolve.h)"
    parser.add_argument("parts", nargs="*", metavar="PART", help=told)
    parser.add_argument("--list", action="store_true", help="say which faults these are, and put none in")
    given = parser.parse_args(arguments)
    chosen = chosen_by(given.parts)
    if given.list:
        print("| fault | file |\n|---|---|", *(f"| {each.fault} | {each.file} |" for each in chosen), sep="\n")
        return
    rotten = [mutation.fault for mutation in MUTATIONS if occurrences(mutation) != 1]
    if rotten:
        raise SystemExit(f"text not found exactly once: {'; '.join(rotten)}")
    living = []
    print("| fault | file | noticed by bits | noticed by values |\n|---|---|---|---|", flush=True)
    for mutation, bits, values in results(chosen):
        print(f"| {mutation.fault} | {mutation.file} | {bits or '-'} | {values or '-'} |", flush=True)
        living += [] if bits or values else [mutation.fault]
    print(f"\n{len(chosen) - len(living)} of {len(chosen)} noticed", *living, sep="\n")
    raise SystemExit(1 if living else 0)


if __name__ == "__main__":
    main()
