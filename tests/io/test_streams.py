"""Reading ahead and writing behind together: threads end with what they serve, however that ends."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from cltaa.io.exr_read import read_image
from cltaa.io.streams import Writer, read_ahead
from tests.io.stream_threads import PATIENCE, Counted, image, stream_threads
from tests.sequence_factory import write_sequence


def test_forgotten_reader_and_writer_end_their_threads(tmp_path: Path) -> None:
    numbers, writer, gate = read_ahead(Counted(1000)), Writer(), threading.Event()

    def held() -> dict[str, np.ndarray]:
        assert gate.wait(PATIENCE)
        return image(0)

    next(numbers)
    for number in range(2):
        writer.write(tmp_path / f"{number}.exr", held)
    assert len(stream_threads()) == 3  # the second image needs a thread of its own while the first is not done
    gate.set()
    del numbers, writer
    gc.collect()
    assert stream_threads() == []


SCRIPT = """
import sys, time
from pathlib import Path
import numpy as np
from cltaa.io.sequence import open_sequence
from cltaa.io.streams import Writer, read_ahead
frames, writer = read_ahead(open_sequence(sys.argv[1])), Writer()
for frame in frames:
    writer.write(Path(sys.argv[2]) / f"{frame.index}.exr", {"Z": frame.depth})
    print("written", flush=True)
    if len(sys.argv) > 3:
        while True:  # in short naps: a signal that comes just before a sleep is only seen after it
            time.sleep(0.1)
    break
"""


@pytest.mark.parametrize("interrupted", [False, True])
def test_program_that_ends_or_is_interrupted_does_not_hang(tmp_path: Path, interrupted: bool) -> None:
    """Threads are neither waited for in vain nor killed inside OpenEXR, and the queued image is complete."""
    folder = write_sequence(tmp_path / "in", 4)
    arguments = [sys.executable, "-c", SCRIPT, str(folder), str(tmp_path)] + ["wait"] * interrupted
    root = Path(__file__).parents[2]
    with subprocess.Popen(arguments, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        if interrupted:
            process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert ("KeyboardInterrupt" in errors) == interrupted
    assert process.returncode in ((1, -signal.SIGINT) if interrupted else (0,))  # an abort would be -6
    assert read_image(tmp_path / "0.exr")[0]["Z"].shape == (23, 37)
