"""The laws of the house that no other tool looks after: import arrows, names, sizes, and the public list."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import cltaa

TOP = Path(__file__).parents[1]
PACKAGES = {
    "cltaa": TOP / "cltaa",
    "cltaa_capture": TOP / "capture" / "cltaa_capture",
    "cltaa_datasets": TOP / "datasets_gen" / "cltaa_datasets",
}
SOURCES = sorted(path for folder in PACKAGES.values() for path in folder.rglob("*.py"))

# package -> what it must not import, at any depth of nesting
FORBIDDEN = {
    "cltaa": {"cltaa_capture", "cltaa_datasets", "OpenGL", "pyrender"},
    "cltaa_capture": {"pyopencl", "cltaa.devices", "cltaa.resolve"},
    "cltaa_datasets": {"cltaa_capture", "OpenGL", "pyrender", "pyopencl"},
}
# The packages of cltaa in the order of its data: each imports only those before it. What lies beside them is for all.
LAYERS = (
    "memory",
    "files",
    "parameters",
    "exr",
    "sequences",
    "pictures",
    "inputs",
    "reference",
    "devices",
    "planning",
    "resolve",
    "judging",
    "inspection",
    "checking",
    "tuning",
    "bench",
    "commands",
)
# The only modules that speak OpenCL.
SPEAK_OPENCL = {TOP / "cltaa" / "devices" / name for name in ("device.py", "program.py", "free_calls.py")}

VAGUE_NAME = re.compile(r"(?i)(manager|helper|utils?$|utils?_|^common|_common|_misc|^misc)")
LONGEST_MODULE, LONGEST_FUNCTION = 600, 40  # lines, docs/design.md

PUBLIC = [
    "Camera",
    "Choices",
    "CltaaError",
    "Effect",
    "Frame",
    "Preset",
    "Resolver",
    "Sequence",
    "Settings",
    "load_preset",
    "open_sequence",
    "plan",
]


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def offences(name: str, banned: set[str]) -> bool:
    return any(name == other or name.startswith(other + ".") for other in banned)


def name_of(path: Path) -> str:
    return str(path.relative_to(TOP))


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_imports_go_one_way(path: Path) -> None:
    package = next(name for name, folder in PACKAGES.items() if path.is_relative_to(folder))
    banned = set(FORBIDDEN[package])
    if path not in SPEAK_OPENCL:
        banned.add("pyopencl")
    assert [name for name in imported(ast.parse(path.read_text())) if offences(name, banned)] == []


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_only_commands_use_what_benchmarks_are_made_of(path: Path) -> None:
    # What both a benchmark and the rest need, as timing, lies beside both; only the command line knows of all.
    if not any(path.is_relative_to(PACKAGES["cltaa"] / name) for name in ("bench", "commands")):
        assert [name for name in imported(ast.parse(path.read_text())) if offences(name, {"cltaa.bench"})] == []


@pytest.mark.parametrize("layer", LAYERS)
def test_packages_import_what_comes_before_them(layer: str) -> None:
    later = {f"cltaa.{name}" for name in LAYERS[LAYERS.index(layer) + 1 :]}
    upwards = {
        f"{name_of(path)}: {name}"
        for path in (PACKAGES["cltaa"] / layer).rglob("*.py")
        for name in imported(ast.parse(path.read_text()))
        if offences(name, later)
    }
    assert upwards == set()


def test_every_package_is_a_layer() -> None:
    assert {path.parent.name for path in PACKAGES["cltaa"].glob("*/__init__.py")} == set(LAYERS)


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_no_vague_names(path: Path) -> None:
    tree = ast.parse(path.read_text())
    defined = [n.name for n in ast.walk(tree) if isinstance(n, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)]
    assert [name for name in [path.stem, path.parent.name, *defined] if VAGUE_NAME.search(name)] == []


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_modules_and_functions_are_small(path: Path) -> None:
    text = path.read_text()
    long = {path.name: text.count("\n")} if text.count("\n") > LONGEST_MODULE else {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node, clean=False) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body and body[-1].end_lineno else 0
            if lines > LONGEST_FUNCTION:
                long[node.name] = lines
    assert long == {}


def test_american_spelling_stays_out() -> None:
    # What other libraries spell so (an argument, an attribute) is a word of theirs; names of our own are not.
    american = re.compile(r"(?i)(color|neighbor|normaliz|center)")
    ours = {
        f"{name_of(path)}: {node.name}"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and american.search(node.name)
    }
    assert ours == set()


def test_the_public_names_are_pinned() -> None:
    assert cltaa.__all__ == PUBLIC
    assert all(getattr(cltaa, name) for name in PUBLIC)


def test_a_planted_import_is_seen() -> None:
    planted = ast.parse("def f():\n    from cltaa_capture import render\n    import pyopencl as cl\n")
    assert [name for name in imported(planted) if offences(name, FORBIDDEN["cltaa"] | {"pyopencl"})] == [
        "cltaa_capture",
        "cltaa_capture.render",
        "pyopencl",
    ]
