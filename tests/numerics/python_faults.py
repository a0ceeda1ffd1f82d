"""Single faults put into the Python of ``cltaa`` to see that the tests notice: ``sh scripts/mutate --python``.

Faults are made from the syntax tree and chosen by a seed, each kind equally often. Each stands alone in a copy of the
tree, in which the tests that are nearest to its module run until one fails or their time is up. Nearest are those named
after the module, that import it, that quote a text of it, that lie in its folder, or that reach it over other modules.
"""

from __future__ import annotations

import argparse
import ast
import copy
import math
import random
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

from tests.numerics import time_limit
from tests.numerics.mutations import TOP, copy_tree, run_tests
from tests.test_architecture import imported
from tests.test_messages import WORDS, parts_of, pieces, plain

SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
}
# Words whose loss changes no result: what is printed for people, and what guards against mistakes of programmers.
IDLE_KEYWORDS = {"help", "metavar", "show_default", "frozen", "slots", "kw_only", "strict", "encoding", "check"}
SECONDS = 40.0  # of the processor for the tests of one fault
PATIENCE = 600.0  # of the clock, after which a run counts as hung
FILES = 12  # of tests for one fault; each takes time to collect


class Fault(NamedTuple):
    """In ``file`` the bytes ``start`` to ``end``, ``right``, are replaced by ``wrong``."""

    kind: str
    file: str
    line: int
    start: int
    end: int
    right: str
    wrong: str

    def __str__(self) -> str:
        """One line."""
        right, wrong = (" ".join(text.split()) for text in (self.right, self.wrong))
        return f"{self.file}:{self.line} {self.kind}: {_cut(right)} -> {_cut(wrong)}"


def _cut(text: str) -> str:
    return text if len(text) <= 100 else text[:97] + "..."


class Finder(ast.NodeVisitor):
    """Collects the faults of one file."""

    def __init__(self, file: str, text: str) -> None:
        self.found: list[Fault] = []
        self._file = file
        self._bytes = text.encode()
        self._lines = [0]
        for line in self._bytes.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))

    def _add(self, kind: str, node: Any, wrong: str) -> None:
        start = self._lines[node.lineno - 1] + node.col_offset
        end = self._lines[node.end_lineno - 1] + node.end_col_offset
        self.found.append(Fault(kind, self._file, node.lineno, start, end, self._bytes[start:end].decode(), wrong))

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave out texts: up to Python 3.11 their parts do not know where they stand."""

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in IDLE_KEYWORDS:
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if any(ast.unparse(decorator) == "overload" for decorator in node.decorator_list):  # for mypy, which tells
            return
        for default in [*node.args.defaults, *filter(None, node.args.kw_defaults)]:
            self._constant("default changed", default)
        for child in [*node.decorator_list, *node.body]:
            self.visit(child)

    def visit_If(self, node: ast.If) -> None:
        if not ast.unparse(node.test).endswith("TYPE_CHECKING"):
            self._branch(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._branch(node)

    def visit_While(self, node: ast.While) -> None:
        if not isinstance(node.test, ast.Constant):
            self._branch(node)

    def _branch(self, node: ast.If | ast.IfExp | ast.While) -> None:
        self._add("branch negated", node.test, f"(not ({ast.unparse(node.test)}))")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        for place, keyword in enumerate(node.keywords):
            if keyword.arg and keyword.arg not in IDLE_KEYWORDS:
                less = copy.deepcopy(node)
                del less.keywords[place]
                self._add("argument dropped", node, ast.unparse(less))
        if len(node.args) > 1 and not isinstance(node.args[-1], ast.Starred):
            less = copy.deepcopy(node)
            del less.args[-1]
            self._add("argument dropped", node, ast.unparse(less))
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        other = copy.deepcopy(node)
        other.ops[0] = SWAPPED[type(node.ops[0])]()  # type: ignore[call-overload]
        self._add("operator swapped", node, f"({ast.unparse(other)})")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._operator(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in SWAPPED and not _holds_text(node):
            self._operator(node)
        else:
            self.generic_visit(node)

    def _operator(self, node: ast.BoolOp | ast.BinOp) -> None:
        other: Any = copy.deepcopy(node)
        other.op = SWAPPED[type(node.op)]()
        self._add("operator swapped", node, f"({ast.unparse(other)})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        self._constant("constant changed", node)

    def _constant(self, kind: str, node: ast.expr) -> None:
        if isinstance(node, ast.Constant) and isinstance(node.value, bool):
            self._add(kind, node, str(not node.value))
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            self._add(kind, node, repr(node.value + 1))

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is None:
            return
        if isinstance(node.value, ast.Compare | ast.BoolOp):
            self._add("return replaced", node.value, f"(not ({ast.unparse(node.value)}))")
        elif isinstance(node.value, ast.Tuple) and len(node.value.elts) > 1:
            first, second, *rest = node.value.elts
            self._add("return replaced", node.value, ast.unparse(ast.Tuple([second, first, *rest], ast.Load())))
        elif ast.unparse(node.value) != "None":
            self._add("return replaced", node.value, "None")
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._add("raise removed", node, "pass")
        self.generic_visit(node)


def _holds_text(node: ast.AST) -> bool:
    return any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in ast.walk(node))


def faults_of(file: str, text: str) -> list[Fault]:
    """Every fault that can be put into a file."""
    finder = Finder(file, text)
    finder.visit(ast.parse(text))
    return finder.found


def faulty(content: bytes, fault: Fault) -> bytes:
    """The content of a file with a fault in it."""
    return content[: fault.start] + fault.wrong.encode() + content[fault.end :]


def is_python(content: bytes) -> bool:
    """Whether a file can still be read; a sum in place of a pattern cannot."""
    try:
        ast.parse(content)
    except SyntaxError:
        return False
    return True


def chosen(parts: Sequence[str], seed: int, count: int, top: Path = TOP) -> list[Fault]:
    """``count`` faults of the files whose paths hold one of ``parts`` (any without them), each kind equally often."""
    kinds: dict[str, list[Fault]] = defaultdict(list)
    for path in sorted((top / "cltaa").rglob("*.py")):
        file = path.relative_to(top).as_posix()
        if not parts or any(part in file for part in parts):
            for fault in faults_of(file, path.read_text(encoding="utf-8")):
                kinds[fault.kind].append(fault)
    rng = random.Random(seed)
    for each in kinds.values():
        rng.shuffle(each)
    found: list[Fault] = []
    while kinds and len(found) < count:
        kind = rng.choice(sorted(kinds))
        fault = kinds[kind].pop()
        if is_python(faulty((top / fault.file).read_bytes(), fault)):
            found.append(fault)
        if not kinds[kind]:
            del kinds[kind]
    return found


def dotted(file: str) -> str:
    """The dotted name of a module."""
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


@cache
def imports(top: Path) -> Mapping[str, frozenset[str]]:
    """Which modules each module of ``cltaa`` and of the tests imports, at any depth of nesting."""
    trees = {
        dotted(path.relative_to(top).as_posix()): ast.parse(path.read_text(encoding="utf-8"))
        for folder in ("cltaa", "tests")
        for path in (top / folder).rglob("*.py")
    }
    return {name: frozenset({*imported(tree)} & {*trees} - {"cltaa"}) for name, tree in trees.items()}


@cache
def texts(top: Path) -> Mapping[Path, str]:
    """What each file of tests says."""
    return {path: plain(path.read_text(encoding="utf-8")) for path in sorted((top / "tests").rglob("test_*.py"))}


def told_by(tree: ast.AST) -> set[str]:
    """A few words in a row of each text of a module, by which tests that look for a message know it."""
    comments = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts_of_it = {node for node in ast.walk(tree) if isinstance(node, ast.expr)} - comments
    told = (part for node in texts_of_it for part in parts_of(node))
    return {plain(piece) for text in told for piece in pieces(text) if piece.count(" ") == WORDS - 1}


def nearest_tests(file: str, top: Path = TOP) -> list[str]:
    """The files of tests that are nearest to a module, the nearest first."""
    module, known, words = dotted(file), imports(top), set(Path(file).stem.split("_"))
    told = told_by(ast.parse((top / file).read_text(encoding="utf-8")))
    distances, way = {module: 0}, [module]
    for name in way:  # which grows
        for other in (other for other, needs in known.items() if name in needs and other not in distances):
            distances[other] = distances[name] + 1
            way.append(other)

    def nearness(path: Path) -> float:
        distance = distances.get(dotted(path.relative_to(top).as_posix()))
        named = len(words & set(path.stem.split("_"))) / len(words)
        same_folder = path.parent.name == Path(file).parent.name
        quoted = any(piece in texts(top)[path] for piece in told)
        return 4.0 * named + 2.0 * same_folder + 3.0 * quoted + (6.0 / distance if distance else 0.0)

    paths = sorted(texts(top), key=lambda path: (-nearness(path), path))
    return [path.relative_to(top).as_posix() for path in paths[:FILES] if nearness(path) > 0.0]


def noticed_by(tree: Path, tests: Sequence[str], seconds: float = SECONDS) -> str:
    """The first test that fails in a tree within ``seconds`` of the processor, or nothing."""
    arguments, patience = ["-p", time_limit.__name__, *tests], PATIENCE if math.isfinite(seconds) else None
    run = run_tests(tree, arguments, patience, "kernels", **{time_limit.VARIABLE: str(seconds)})
    if run.code is None:
        return "no end"
    if run.failed:
        return run.failed
    return "" if run.code == 0 or time_limit.TOLD in run.said else f"pytest ended with {run.code}"


def results(faults: Sequence[Fault], jobs: int) -> Iterator[tuple[Fault, str]]:
    """Each fault with the test that noticed it; SystemExit where such a test fails without any fault."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for job in range(jobs):
            copy_tree(Path(folder) / str(job))
            trees.put(Path(folder) / str(job))

        def tried(fault: Fault) -> str:
            tree = trees.get()
            path = tree / fault.file
            right = path.read_bytes()
            path.write_bytes(faulty(right, fault))
            try:
                return noticed_by(tree, nearest_tests(fault.file))
            finally:
                path.write_bytes(right)
                trees.put(tree)

        seen = set()
        for fault, noticed in zip(faults, pool.map(tried, faults), strict=True):
            seen |= {noticed} if "::" in noticed else set()
            yield fault, noticed
        if seen and (unsound := noticed_by(trees.get(), sorted(seen), float("inf"))):
            raise SystemExit(f"fails without any fault: {unsound}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print each fault and who noticed it, then those that nobody did; exit with 1 where there are such."""
    parser = argparse.ArgumentParser(prog="scripts/mutate --python", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help="only files whose paths hold one of these texts")
    parser.add_argument("--seed", type=int, default=0, help="which faults")
    parser.add_argument("--count", type=int, default=200, help="how many")
    parser.add_argument("--jobs", type=int, default=2, help="copies of the tree that are tested at a time")
    parser.add_argument("--list", action="store_true", help="say which faults these are, and put none in")
    given = parser.parse_args(arguments)
    faults = chosen(given.parts, given.seed, given.count)
    if given.list:
        print(*faults, sep="\n")
        return
    living = []
    for fault, noticed in results(faults, given.jobs):
        print(f"{fault} | {noticed or 'lives'}", flush=True)
        living += [] if noticed else [fault]
    print(f"\n{len(faults) - len(living)} of {len(faults)} noticed", *living, sep="\n")
    raise SystemExit(1 if living else 0)


if __name__ == "__main__":
    main()
