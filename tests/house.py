"""Counts of the house: ``sh scripts/house [--frame]`` prints modules, lines, import arrows, words and tests as JSON.

``--frame`` also counts what one more frame of a resolve runs through: the functions that two traced resolves, of 8 and
of 12 frames, call different numbers of times. Numbers of two commits compare only where this same file counted both.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.test_architecture import SOURCES, TOP, circles, module_of, needed, sources

FRAMES = (8, 12)  # of the two traced resolves


def lines(paths: list[Path]) -> int:
    """Lines of all the files."""
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def words(paths: list[Path]) -> int:
    """Words of all the files."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def counts() -> dict[str, object]:
    """The house: a name and a number, or a table of numbers, each."""
    found = {name: path for path in SOURCES if (name := module_of(path)).split(".")[0] == "cltaa"}
    trees = {name: sources()[name] for name in found}
    arrows = {name: {*needed(tree, trees)} - {name} for name, tree in trees.items()}
    own = [path for path in found.values() if path.name != "__init__.py"]
    packages = Counter(name.split(".")[1] if name.count(".") > 1 else "top" for name in arrows)
    kernels = [p for p in TOP.glob("kernels/**/*") if p.suffix in (".cl", ".h") and "bench" not in p.parts]
    pages = [p for p in [*TOP.glob("*.md"), *TOP.glob("docs/**/*.md")] if p.name != "CHANGELOG.md"]
    generated = [p for p in pages if "generated" in p.parts]
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
        "circles": circles(trees),
        "kernel files": len(kernels),
        "kernel lines": lines(kernels),
        "lines of resolve.cl": lines([TOP / "kernels" / "resolve.cl"]),
        "test files": len(list(TOP.glob("tests/**/*.py"))),
        "test lines": lines(list(TOP.glob("tests/**/*.py"))),
        "decision pages": len(list(TOP.glob("docs/decisions/[0-9]*.md"))),
        "words": words([p for p in pages if p not in generated]),
        "words on the newcomer's path": words([TOP / p for p in path if (TOP / p).exists()]),
        "words generated": words(generated),
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
    print(json.dumps(counts() | (frame_path() if "--frame" in sys.argv[1:] else {}), indent=2))
