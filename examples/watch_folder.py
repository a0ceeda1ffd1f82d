"""A folder that a farm writes, resolved while it does: python examples/watch_folder.py [FOLDER [OUTPUT]]

Without a folder a thread plays the farm: it writes frames one by one, as a renderer would, and is done after a while.
From a shell the same is: cltaa resolve FOLDER -o OUTPUT --follow --idle 5
"""

import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import cltaa

height, width, frames = 90, 160, 6


def farm(folder: Path) -> None:
    """Write noise on a wall 5 units away, a frame at a time."""
    samples = np.random.default_rng(0)
    depth = np.full((height, width), 5, np.float32)
    projection = np.array([[1.0, 0, 0, 0], [0, width / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]])
    for index in range(frames):
        time.sleep(0.2)  # it renders
        colour = samples.random((height, width, 3), np.float32)
        frame = cltaa.Frame(index, colour, depth, cltaa.Camera(np.eye(4), projection))
        cltaa.write_frame(folder / f"wall.{index:04d}.exr", frame)


folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
output = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "resolved"
if len(sys.argv) == 1:
    threading.Thread(target=farm, args=[folder]).start()

# Each frame as soon as its file is whole, in their order; ends when none came for two seconds. With
# reading={"frames": (0, 99)} it ends with the last of them. Ctrl-C ends it at once: the next run goes on from there.
report = cltaa.resolve(folder, output, follow=True, idle=2.0)
print(f"{report.resolved} frames resolved into {report.output}")
