"""Counts of the house: ``sh scripts/house [--frame]`` prints modules, lines, import arrows, words and tests as JSON.

``--frame`` also counts what one more frame of a resolve runs through: the functions that two traced resolves, of 8 and
of 12 frames, call different numbers of times. Numbers of two commits compare only where this same file counted both.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

TOP = Path(__file__).parents[1]
FRAMES = (8, 12)  # of the two traced resolves


def modules(top: Path) -> dict[str, Path]:
    """Every module of cltaa by its dotted name; packages by theirs."""
    paths = sorted(top.glob("cltaa/**/*.py"))
    return {".".join(path.relative_to(top).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}


def import_arrows(found: dict[str, Path]) -> dict[str, set[str]]:
    """Modules that each module imports while it is itself imported."""
    arrows: dict[str, set[str]] = {name: set() for name in found}
    for name, path in found.items():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            arrows[name] |= {other for other in names if other in found and other != name}
    return arrows


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, each reachable from each."""

    def reach(start: str) -> set[str]:
        seen: set[str] = set()
        left = [start]
        while left:
            for other in arrows[left.pop()] - seen:
                seen.add(other)
                left.append(other)
        return seen

    reached = {name: reach(name) for name in arrows}
    groups = {tuple(sorted(o for o in reached[n] if n in reached[o])) for n in arrows if n in reached[n]}
    return [list(group) for group in sorted(groups)]


def lines(paths: list[Path]) -> int:
    """Lines of all the files."""
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def words(paths: list[Path]) -> int:
    """Words of all the files."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def counts(top: Path) -> dict[str, object]:
    """The house at ``top``: a name and a number, or a table of numbers, each."""
    found = modules(top)
    arrows = import_arrows(found)
    own = [path for path in found.values() if path.name != "__init__.py"]
    packages = Counter(name.split(".")[1] if name.count(".") > 1 else "top" for name in arrows)
    kernels = [p for p in top.glob("kernels/**/*") if p.suffix in (".cl", ".h") and "bench" not in p.parts]
    pages = [p for p in [*top.glob("*.md"), *top.glob("docs/**/*.md")] if p.name != "CHANGELOG.md"]
    apart = [p for p in pages if {"generated", "lab-notes"} & set(p.parts)]
    path = ["README.md", *(f"docs/{n}.md" for n in ("tour", "conventions", "python", "inputs", "algorithm", "design"))]
    between = {(a.split(".")[1], b.split(".")[1]) for a in arrows for b in arrows[a] if a.count(".") and b.count(".")}
    return {
        "modules": len(own),
        "modules a package": dict(sorted(packages.items())),
        "lines": lines(list(found.values())),
        "lines a package": {
            package: lines([p for n, p in found.items() if n.split(".")[1:2] == [package]])
            for package in sorted({n.split(".")[1] for n in found if n.count(".") > 1})
        },
        "import arrows": sum(map(len, arrows.values())),
        "arrows between packages": sum(a != b for a, b in between),
        "circles": circles(arrows),
        "kernel files": len(kernels),
        "kernel lines": lines(kernels),
        "lines of resolve.cl": lines([top / "kernels" / "resolve.cl"]),
        "test files": len(list(top.glob("tests/**/*.py"))),
        "test lines": lines(list(top.glob("tests/**/*.py"))),
        "decision pages": len(list(top.glob("docs/decisions/[0-9]*.md"))),
        "words": words([p for p in pages if p not in apart]),
        "words on the newcomer's path": words([top / p for p in path if (top / p).exists()]),
        "words generated and in lab notes": words(apart),
    }


def traced(frames: int, folder: Path) -> Counter[tuple[str, str]]:
    """Calls of each function of cltaa, by file and name, in a resolve of the first ``frames`` frames in ``folder``."""
    out, counted = folder / f"out{frames}", folder / f"calls{frames}.json"
    code = f"""
import collections, json, os, sys, threading
calls = collections.Counter()
def profile(frame, event, _):
    if event == "call" and "{os.sep}cltaa{os.sep}" in frame.f_code.co_filename and "<" not in frame.f_code.co_name:
        calls[frame.f_code.co_filename.rpartition("{os.sep}cltaa{os.sep}")[2] + " " + frame.f_code.co_qualname] += 1
import cltaa.cli
threading.setprofile(profile)
sys.setprofile(profile)
sys.argv = ["cltaa", "resolve", {str(folder / "sequence")!r}, "-o", {str(out)!r}, "--frames", "0-{frames - 1}"]
try:
    cltaa.cli.main()
finally:
    sys.setprofile(None)
    json.dump(dict(calls), open({str(counted)!r}, "w"))
"""
    subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, cwd=TOP)
    return Counter({tuple(key.split(" ", 1)): n for key, n in json.loads(counted.read_text()).items()})


def frame_path() -> dict[str, int]:
    """Functions and files that one more frame of a resolve runs through."""
    from tests.sequence_factory import write_sequence

    with tempfile.TemporaryDirectory() as name:
        write_sequence(Path(name) / "sequence", FRAMES[1])
        few, many = (traced(frames, Path(name)) for frames in FRAMES)
    more = {where for where in many if many[where] - few[where] >= FRAMES[1] - FRAMES[0]}
    return {"functions a frame": len(more), "files a frame": len({file for file, _ in more})}


if __name__ == "__main__":
    print(json.dumps(counts(TOP) | (frame_path() if "--frame" in sys.argv[1:] else {}), indent=2))
