"""Every error message of the source, and what it says to do, is asked for by a test: none is lost unnoticed."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.test_architecture import TOP, sources

WORDS = 3  # in a row that a test has to have of a message, or all that stand between two of its values
LEAST = 6  # letters of these

# Message -> why no test can, or need, have it.
BROKEN_OPENGL = "only an OpenGL that lacks or refuses something says it"
OWN_FAULT = "only a fault of our own code or shaders says it"
UNTESTED = {
    "no such backend: ": "click refuses the word first",
    "OpenGL is already bound to ": "PyOpenGL binds once a process; its tests run in processes of their own",
    "choose the backend in a new process": "the same",
    "no off-screen OpenGL: pyrender opens it in assertions, which -O leaves out": "needs python -O",
    "no off-screen OpenGL: {} gave no current context": BROKEN_OPENGL,
    "no off-screen OpenGL: {} cannot be loaded": BROKEN_OPENGL,
    "no off-screen OpenGL: {} gave no context ({})": BROKEN_OPENGL,
    "no off-screen OpenGL: ": BROKEN_OPENGL,
    "shader does not compile with {}: ": OWN_FAULT,
    "shaders do not link: ": OWN_FAULT,
    "OpenGL refuses a shadow map of {}x": BROKEN_OPENGL,
    "this OpenGL has no GL_ARB_clip_control": BROKEN_OPENGL,
    "give the scene a smaller one": BROKEN_OPENGL,
    "OpenGL refuses a float framebuffer of {}x": BROKEN_OPENGL,
    "a worker process was killed": "to be written: a worker that kills itself",
    "not of this format": "to be written: the record of another version",
    "not as many chunks as the windows ask for": "to be written: chunkCount of one of several parts",
    "encoding failed: ": "only an encoder that fails says it",
    "no turn centres a jitter of {} points": "there is one, as its docstring shows",
    "no asset in it": "the error around it is tested",
    "parts of one name, or of a name that could harm a terminal": "the error around it is tested",
    " of {} vertices, POSITION of ": "the error around it is tested",
}


def parts_of(message: ast.expr) -> list[str]:
    """The text of a message between its values."""
    if isinstance(message, ast.Constant) and isinstance(message.value, str):
        return [message.value]
    if isinstance(message, ast.JoinedStr):
        return [str(part.value) for part in message.values if isinstance(part, ast.Constant)]
    return []


def messages() -> Iterator[tuple[str, str]]:
    """The module and the text of every error that is raised with one, and of every cure; values are written as {}."""
    for module, tree in sources().items():
        for node in ast.walk(tree):
            told: list[ast.expr] = []
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                told = node.exc.args[:1]
            elif isinstance(node, ast.Call):
                told = [keyword.value for keyword in node.keywords if keyword.arg == "cure"]
            for parts in map(parts_of, told):
                if any(len(part.strip()) >= LEAST for part in parts):
                    yield module, "{}".join(parts)


def pieces(message: str) -> Iterator[str]:
    """What of a message tells it from others: each few words in a row."""
    for part in message.split("{}"):
        words = part.strip(" :;,()").split()
        for place in range(max(1, len(words) - WORDS + 1)):
            piece = " ".join(words[place : place + WORDS])
            if len(piece) >= LEAST:
                yield piece


def plain(text: str) -> str:
    """A text with single spaces, and without the signs that keep regular expressions quiet."""
    return " ".join(text.replace("\\", "").split())


def texts_of(path: Path) -> Iterator[str]:
    """The texts in a file's code: what a comment or a docstring says asks for nothing."""
    tree = ast.parse(path.read_text())
    comments = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in comments:
            yield node.value


def mentioned() -> str:
    """All texts of the tests, but for this file's."""
    paths = [path for path in sorted((TOP / "tests").rglob("*.py")) if path != Path(__file__)]
    return plain(" | ".join(text for path in paths for text in texts_of(path)))


def test_every_message_is_mentioned_by_a_test() -> None:
    tests = mentioned()
    unmentioned = {
        message: module for module, message in messages() if not any(plain(piece) in tests for piece in pieces(message))
    }
    assert {message: module for message, module in unmentioned.items() if message not in UNTESTED} == {}
    assert {message for message in UNTESTED if message not in unmentioned} == set(), "mentioned now, or gone"
