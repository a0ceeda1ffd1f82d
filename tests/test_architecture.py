"""The laws of the house that no other tool looks after: import arrows, circles, names, sizes, the public list.

Each law is one test that names every offender, and a test with planted offenders shows that the law sees them.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from functools import cache
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
    "cltaa_capture": {"pyopencl", "cltaa.core.resolver", "cltaa.opencl"},
    "cltaa_datasets": {"cltaa_capture", "OpenGL", "pyrender", "pyopencl"},
}
# The packages of cltaa, lowest row first: a module imports from rows above its own in this table, and from its own
# package. Packages that share a row do not import each other.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("core",),
    ("opencl", "reference"),
    ("io",),
    ("inputs",),
    ("pipeline",),
    ("lab",),
    ("commands",),
)
# Modules beside the packages that all of these may import, and that import none of them.
BELOW = {"camera", "errors", "frame", "printable", "process", "progress", "renamed"}
# The one arrow upwards: a resolver that is given no launcher asks for one by the name of its device.
CHOOSES_LAUNCHER = "cltaa.core.backend"
# The only modules that speak OpenCL.
SPEAK_OPENCL = {f"cltaa.opencl.{name}" for name in ("device", "exchange")}

VAGUE_NAME = re.compile(r"(?i)(manager|helper|utils?$|utils?_|^common|_common|_misc|^misc)")
AMERICAN = re.compile(r"(?i)(color|neighbor|normaliz|center)")
LONGEST_MODULE = 600  # lines; a module is one idea, and what takes longer to read than this holds two
LONGEST_FUNCTION = (
    60  # lines without the docstring: what an editor shows on one screen, so nobody scrolls to see a loop end
)

PUBLIC = [
    "Camera",
    "Choices",
    "CltaaError",
    "Effect",
    "Frame",
    "FrameSequence",
    "Preset",
    "Resolver",
    "Settings",
    "check",
    "inspect",
    "load_preset",
    "measure",
    "open",
    "plan",
    "resolve",
    "write_frame",
]


def module_of(path: Path) -> str:
    """The dotted name of a source file; a package goes by its own name."""
    package, folder = next(item for item in PACKAGES.items() if path.is_relative_to(item[1]))
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join([package, *(part for part in parts if part != "__init__")])


@cache
def sources() -> dict[str, ast.Module]:
    """Every module of the three packages by its dotted name."""
    return {module_of(path): ast.parse(path.read_text()) for path in SOURCES}


def imported(tree: ast.AST) -> Iterator[str]:
    """What a module imports at any depth of nesting."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def needed(tree: ast.Module, modules: Mapping[str, ast.Module]) -> Iterator[str]:
    """Which of ``modules`` a module needs to be imported: nothing inside functions, nothing for type checkers alone."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            yield from names & {*modules} or {node.module or ""} & {*modules}
        elif isinstance(node, ast.Import):
            yield from {alias.name for alias in node.names} & {*modules}
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            waiting += node.orelse
        else:
            waiting += ast.iter_child_nodes(node)


def offences(name: str, banned: set[str]) -> bool:
    return any(name == other or name.startswith(other + ".") for other in banned)


def offenders(modules: Mapping[str, ast.Module], banned: set[str]) -> list[str]:
    """The imports of ``modules`` that ``banned`` forbids, one line each."""
    return [
        f"{module} imports {name}"
        for module, tree in modules.items()
        for name in imported(tree)
        if offences(name, banned)
    ]


def within(package: str, modules: Mapping[str, ast.Module]) -> dict[str, ast.Module]:
    return {name: tree for name, tree in modules.items() if offences(name, {package})}


def upwards(modules: Mapping[str, ast.Module], layers: tuple[tuple[str, ...], ...]) -> list[str]:
    """The imports that do not go to a lower row of ``layers``."""
    found = []
    for row, packages in enumerate(layers):
        for package in packages:
            later = {f"cltaa.{name}" for names in layers[row:] for name in names if name != package}
            found += offenders(within(f"cltaa.{package}", modules), later)
    return found


def circles(modules: Mapping[str, ast.Module]) -> list[str]:
    """Modules that need each other to be imported, as chains that end where they begin."""
    arrows = {name: sorted({*needed(tree, modules)} - {name}) for name, tree in modules.items()}
    found: list[str] = []
    done: set[str] = set()

    def follow(module: str, way: list[str]) -> None:
        if module in way:
            found.append(" -> ".join([*way[way.index(module) :], module]))
        elif module not in done:
            for other in arrows[module]:
                follow(other, [*way, module])
            done.add(module)

    for module in arrows:
        follow(module, [])
    return found


def vague_names(modules: Mapping[str, ast.Module]) -> list[str]:
    return [
        f"{module}: {name}"
        for module, tree in modules.items()
        for name in [*module.split("."), *_defined(tree)]
        if VAGUE_NAME.search(name)
    ]


def american_names(modules: Mapping[str, ast.Module]) -> list[str]:
    """What other libraries spell so (an argument, an attribute) is a word of theirs; names of our own are not."""
    return [f"{module}: {name}" for module, tree in modules.items() for name in _defined(tree) if AMERICAN.search(name)]


def _defined(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name


def long_functions(modules: Mapping[str, ast.Module]) -> list[str]:
    return [
        f"{module}.{node.name}: {_lines(node)} lines"
        for module, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _lines(node) > LONGEST_FUNCTION
    ]


def _lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = node.body[1:] if ast.get_docstring(node, clean=False) else node.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def test_imports_go_one_way() -> None:
    assert [line for name, banned in FORBIDDEN.items() for line in offenders(within(name, sources()), banned)] == []


def test_few_modules_speak_opencl() -> None:
    others = {name: tree for name, tree in sources().items() if name not in SPEAK_OPENCL}
    assert {*sources()} >= SPEAK_OPENCL
    assert offenders(others, {"pyopencl"}) == []


def test_packages_import_what_comes_before_them() -> None:
    others = {name: tree for name, tree in sources().items() if name != CHOOSES_LAUNCHER}
    assert upwards(others, LAYERS) == []


def test_what_all_may_import_imports_no_package() -> None:
    packages = {f"cltaa.{name}" for row in LAYERS for name in row}
    below = {f"cltaa.{name}": sources()[f"cltaa.{name}"] for name in BELOW}
    assert offenders(below, packages) == []


def test_words_of_commands_are_quoted_in_one_way() -> None:
    """``shlex.quote`` alone takes a path ``-x`` for plain, and keeps a line feed, which no message can hold."""
    assert {module for module, tree in sources().items() if "shlex" in {*imported(tree)}} == {"cltaa.printable"}


def test_every_package_is_a_layer() -> None:
    named = [name for row in LAYERS for name in row]
    assert sorted(path.parent.name for path in PACKAGES["cltaa"].glob("*/__init__.py")) == sorted(named)


def test_no_module_needs_itself() -> None:
    assert circles(sources()) == []


def test_no_vague_names() -> None:
    assert vague_names(sources()) == []


def test_american_spelling_stays_out() -> None:
    assert american_names(sources()) == []


def test_modules_are_one_idea() -> None:
    lines = {str(path.relative_to(TOP)): path.read_text().count("\n") for path in SOURCES}
    assert {path: count for path, count in lines.items() if count > LONGEST_MODULE} == {}


def test_functions_fit_on_a_screen() -> None:
    assert long_functions(sources()) == []


def test_every_path_of_a_command_is_refused_when_empty() -> None:
    """All take ``FILE_PATH``, which refuses it; none asks click for a path of its own."""
    assert [str(path.relative_to(TOP)) for path in SOURCES if "type=click.Path(" in path.read_text()] == []


def test_the_public_names_are_pinned() -> None:
    assert cltaa.__all__ == PUBLIC == sorted(PUBLIC)
    assert all(getattr(cltaa, name) for name in PUBLIC)


PLANTED = {
    "cltaa.low.a": "def f():\n    from cltaa_capture import render\n    import pyopencl as cl\n",
    "cltaa.low.b": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import cltaa.high.c\n",
    "cltaa.low.peer": "from cltaa import beside\n",
    "cltaa.high.c": "try:\n    from cltaa.high import d\nexcept ImportError:\n    pass\nimport cltaa.low.b\n",
    "cltaa.high.d": "from cltaa.high.e import name\n",
    "cltaa.high.e": "import cltaa.high.c\ndef f():\n    import cltaa.high.d\n",
    "cltaa.beside.shared_utils": "import cltaa.low.a\nclass ColorManager: ...\ndef long():\n" + "    f()\n" * 61,
}


@pytest.mark.parametrize(
    ("law", "seen"),
    [
        (lambda trees: offenders(trees, {"cltaa_capture"}), ["low.a imports cltaa_capture", ".render"]),
        (lambda trees: offenders(trees, {"pyopencl"}), ["cltaa.low.a imports pyopencl"]),
        (lambda trees: upwards(trees, (("low",), ("high",))), ["cltaa.low.b imports cltaa.high.c"]),
        (
            lambda trees: upwards(trees, (("low", "beside"),)),
            ["cltaa.low.peer imports cltaa.beside", "cltaa.beside.shared_utils imports cltaa.low.a"],
        ),
        (circles, ["cltaa.high.c -> cltaa.high.d -> cltaa.high.e -> cltaa.high.c"]),
        (vague_names, ["shared_utils: shared_utils", "shared_utils: ColorManager"]),
        (american_names, ["shared_utils: ColorManager"]),
        (long_functions, ["cltaa.beside.shared_utils.long: 61 lines"]),
    ],
)
def test_a_planted_offender_is_seen(law: object, seen: list[str]) -> None:
    assert callable(law)
    lines = law({name: ast.parse(text) for name, text in PLANTED.items()})
    assert len(lines) == len(seen), lines
    assert all(line.endswith(end) for line, end in zip(lines, seen, strict=True)), lines
