"""The same algorithm as a GLSL fragment shader: what somebody with a renderer would try first (extra ``bench``)."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np

from cltaa.bench.baseline import BASELINE
from cltaa.errors import DeviceMissing
from cltaa.extras import import_extra
from cltaa.frames import Frame, Image
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Storage
from cltaa.resolve.frame_record import Past, frame_record

_FOLDER = resources.files("cltaa") / "bench"


class Shader:
    """``resolve.frag`` on float textures of an off-screen context; ``taps`` is 16 (fetches) or 9 (bilinear reads)."""

    def __init__(self, storage: Storage, width: int, height: int, taps: int) -> None:
        moderngl = import_extra("moderngl", package="moderngl", extra="bench", purpose="timing the shader")
        try:
            self._context = moderngl.create_context(standalone=True, backend="egl")
        except Exception as error:  # moderngl raises what its backend raises, Exception itself among others
            raise DeviceMissing(f"no off-screen OpenGL: {error}", cure="see: cltaa doctor") from error
        gl = self._context
        self.renderer = f"{gl.info['GL_RENDERER']}, OpenGL {gl.info['GL_VERSION']}"
        kept = "f4" if storage is Storage.FLOAT else "f2"
        self._current = gl.texture((width, height), 4, dtype="f4")
        self._closeness = gl.texture((width, height), 1, dtype="f4")
        self._history, self._output = (gl.texture((width, height), 4, dtype=kept) for _ in range(2))
        for texture in (self._current, self._closeness, self._history, self._output):
            texture.repeat_x = texture.repeat_y = False
            texture.filter = (gl.NEAREST, gl.NEAREST)
        if taps == 9:
            self._history.filter = self._output.filter = (gl.LINEAR, gl.LINEAR)
        fragment = (_FOLDER / "resolve.frag").read_text(encoding="utf-8")
        self._program = gl.program(
            vertex_shader=(_FOLDER / "resolve.vert").read_text(encoding="utf-8"),
            fragment_shader=fragment.replace("#version 330\n", f"#version 330\n#define TAPS {taps}\n", 1),
        )
        for unit, name in enumerate(("current", "closeness", "history")):
            self._program[name] = unit
        settings = BASELINE.settings
        self._program["limits"] = (
            settings.sample_limit, settings.blend_weight, settings.luminance_knee, settings.box_floor,
        )  # fmt: skip
        self._program["box"] = (settings.gamma_still, settings.gamma_moving, settings.motion_px)
        self._triangle = gl.vertex_array(self._program, [])
        self._targets = {texture: gl.framebuffer([texture]) for texture in (self._history, self._output)}

    def resolve(self, frame: Frame, previous: Frame | None) -> Image:
        """The resolved image [H, W, 3] float32 of ``frame``, whose history is the output of the call before."""
        pixels = np.ones((frame.height, frame.width, 4), np.float32)
        pixels[..., :3] = frame.colour
        self._current.write(pixels.tobytes())
        self._closeness.write((np.float32(1.0) / frame.depth).tobytes())
        past = None if previous is None else Past.of(previous)
        self._program["displacement"] = _matrix(frame_record(frame, past, Layout(frame.width, frame.height)))
        self._history, self._output = self._output, self._history
        self.run()
        kept = np.dtype(np.float16 if self._output.dtype == "f2" else np.float32)
        read = np.frombuffer(self._output.read(), kept).reshape(frame.height, frame.width, 4)
        return read[..., :3].astype(np.float32)

    def run(self) -> float | None:
        """Draw what the last ``resolve`` was given; return the seconds by OpenGL's clock, None where it has none."""
        for unit, texture in enumerate((self._current, self._closeness, self._history)):
            texture.use(unit)
        self._targets[self._output].use()
        query = self._context.query(time=True)
        with query:
            self._triangle.render(vertices=3)
        self._context.finish()
        # A software rasteriser's clock stops when the triangle is binned, not when its pixels are done.
        return None if "pipe" in self.renderer else float(query.elapsed) * 1e-9

    def release(self) -> None:
        """Free the context."""
        self._context.release()


def _matrix(record: np.ndarray[Any, Any]) -> tuple[float, ...]:
    """The rows x, y, w of D and the origin, as the columns of a mat4."""
    rows = [[float(record[letter + by]) for by in "xyq1"] for letter in "xyw"]
    last = [float(record["origin_x"]), float(record["origin_y"]), float(record["reset"]), 0.0]
    return tuple(value for row in [*rows, last] for value in row)
