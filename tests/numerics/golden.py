"""Golden vectors: the bits that each stage gave for 20 pixels, kept in the repository as hexadecimal words.

They pin the twins themselves, so that another NumPy cannot move kernel and twin together. After a meant change of a
stage ``python -m tests.numerics.golden`` writes them again; look at the difference before it is committed.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cltaa.core.build import FRAME_DTYPE, SETTINGS_DTYPE, Build, Record
from cltaa.core.planes import Layout
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import KEPT, Planes, padded
from tests.kernels.stage_chain import ALL_STEPS, STAGES, WRITES, Work, hard_work, run_stage

FOLDER = Path(__file__).parent / "golden"
LAYOUT = Layout(5, 4)
CORNER = 6, 5  # row and column of a hard frame whose 4 x 5 pixels lie in four tiles
SEED = 3  # history is used at 14 of the 20 pixels, rectified at 6 of them; one texel is NaN


def golden_work() -> Work:
    """A piece of a hard frame; what its history is worth follows from a motion within the piece."""
    whole = hard_work(seed=SEED)
    y, x = CORNER
    piece = {
        name: padded(whole.layout.inside(planes)[:, y : y + LAYOUT.height, x : x + LAYOUT.width], LAYOUT)
        for name, planes in whole.planes.items()
    }
    frame, past = whole.frame.copy(), whole.past.copy()
    for record in (frame, past):
        record["width"], record["height"], record["stride"] = LAYOUT.width, LAYOUT.height, LAYOUT.stride
    return Work(LAYOUT, piece, frame, whole.settings, past)


def as_words(planes: NDArray[np.float32]) -> list[list[str]]:
    """[C, rows, stride] -> a row of hexadecimal words a pixel, one a channel."""
    words = LAYOUT.inside(planes).reshape(len(planes), -1).view(np.uint32).T
    return [[f"{word:08x}" for word in pixel] for pixel in words]


def from_words(rows: list[list[str]]) -> NDArray[np.float32]:
    """The inverse, with its halo."""
    words = np.array([[int(word, 16) for word in row] for row in rows], np.uint32)
    return padded(words.T.view(np.float32).reshape(-1, LAYOUT.height, LAYOUT.width), LAYOUT)


def write_table(path: Path, columns: dict[str, NDArray[np.float32]]) -> None:
    """A column a channel, named plane.channel; a row a pixel, from the top left, row by row."""
    names = [f"{name}.{channel}" for name, planes in columns.items() for channel in range(len(planes))]
    pixels = zip(*(as_words(planes) for planes in columns.values()), strict=True)
    rows = [[word for plane in pixel for word in plane] for pixel in pixels]
    with path.open("w", newline="", encoding="ascii") as file:
        csv.writer(file, lineterminator="\n").writerows([names, *rows])


def read_table(path: Path) -> Planes:
    """The padded planes of a table."""
    with path.open(newline="", encoding="ascii") as file:
        names, *rows = csv.reader(file)
    planes = dict.fromkeys(name.partition(".")[0] for name in names)
    columns = {plane: [i for i, name in enumerate(names) if name.partition(".")[0] == plane] for plane in planes}
    return {plane: from_words([[row[i] for i in at] for row in rows]) for plane, at in columns.items()}


def write_struct(path: Path, record: Record) -> None:
    """A line a member: its name and its word."""
    lines = [f"{name},{np.asarray(record[name]).view(np.uint32):08x}\n" for name in record.dtype.names or ()]
    path.write_text("".join(lines), encoding="ascii")


def read_struct(path: Path, dtype: np.dtype[np.void]) -> Record:
    """The struct of a file; members that it does not know are 0."""
    record = np.zeros((), dtype)
    for line in path.read_text(encoding="ascii").splitlines():
        name, _, word = line.partition(",")
        record[name] = np.array(int(word, 16), np.uint32).view(record[name].dtype)
    return record


def read_work() -> Work:
    """The frame that the golden vectors belong to."""
    frame = read_struct(FOLDER / "frame.csv", FRAME_DTYPE)
    settings = read_struct(FOLDER / "settings.csv", SETTINGS_DTYPE)
    past = np.array([read_struct(FOLDER / f"past{place}.csv", FRAME_DTYPE) for place in range(KEPT)], FRAME_DTYPE)
    return Work(LAYOUT, read_table(FOLDER / "input.csv"), frame, settings, past)


def main() -> None:
    """Write the golden vectors again, from the twins as they are."""
    FOLDER.mkdir(exist_ok=True)
    work = golden_work()
    write_table(FOLDER / "input.csv", work.planes)
    write_struct(FOLDER / "frame.csv", work.frame)
    write_struct(FOLDER / "settings.csv", work.settings)
    for place, record in enumerate(work.past):
        write_struct(FOLDER / f"past{place}.csv", record)
    for kernel in WRITES:
        written = run_stage(kernel, Build(steps=ALL_STEPS), work, NumpyLauncher())
        write_table(FOLDER / f"{kernel}.csv", written)
        if kernel in STAGES:
            work.planes.update(written)


if __name__ == "__main__":
    main()
