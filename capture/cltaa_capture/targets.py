"""Render targets: one sample a pixel, float32 from the shader to the array, without the default framebuffer."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL, platform
from OpenGL.raw.GL.VERSION import GL_1_0, GL_1_5  # raw, because the wrappers cannot read into a buffer object

from cltaa.errors import DeviceMissing, ResourceError

GL_ZERO_TO_ONE = 0x935F  # GL_ARB_clip_control, which PyOpenGL 3.1.0 lacks

# Output -> (internal format, read-back format, channels), in the order of the shaders' output locations.
FORMATS = {
    "colour": (GL.GL_RGBA32F, GL.GL_RGBA, 4),
    "motion": (GL.GL_RG32F, GL.GL_RG, 2),
    "reactive": (GL.GL_R32F, GL.GL_RED, 1),
}
CLEARED = {"colour": 0.0, "motion": np.nan, "reactive": 0.0}
FAR = 0.0  # reversed depth of infinity
MOST_WAITING, WAITING_BYTES = 8, 2**25  # most pictures, and bytes, that a Readback holds


def use_reversed_depth() -> None:
    """Set clip space z to [0, 1], with greater meaning nearer; raises DeviceMissing without GL_ARB_clip_control."""
    address = platform.PLATFORM.getExtensionProcedure(b"glClipControl")
    pointer = ctypes.cast(address, ctypes.c_void_p).value
    if pointer is None:
        raise DeviceMissing(
            "this OpenGL has no GL_ARB_clip_control",
            expected="OpenGL 4.5",
            found=GL.glGetString(GL.GL_VERSION).decode(),
        )
    ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(pointer)(GL.GL_LOWER_LEFT, GL_ZERO_TO_ONE)
    GL.glEnable(GL.GL_DEPTH_TEST)
    GL.glDepthFunc(GL.GL_GREATER)


class Target:
    """A framebuffer of single-sample float textures and a 32-bit float depth buffer."""

    def __init__(self, width: int, height: int, outputs: Sequence[str]) -> None:
        """Allocate; ``outputs`` are keys of FORMATS in order. Raises ResourceError if the driver refuses."""
        self.width, self.height, self.outputs = width, height, tuple(outputs)
        self._framebuffer = GL.glGenFramebuffers(1)
        self._textures = [int(name) for name in np.atleast_1d(GL.glGenTextures(len(self.outputs) + 1))]
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        for index, output in enumerate(self.outputs):
            internal, layout, _ = FORMATS[output]
            self._attach(self._textures[index], GL.GL_COLOR_ATTACHMENT0 + index, internal, layout)
        self._attach(self._textures[-1], GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_COMPONENT)
        GL.glDrawBuffers(len(self.outputs), [GL.GL_COLOR_ATTACHMENT0 + i for i in range(len(self.outputs))])
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise ResourceError(f"OpenGL refuses a float framebuffer of {width}x{height}", cure="use a smaller --size")

    def _attach(self, texture: int, attachment: int, internal: int, layout: int) -> None:
        GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, internal, self.width, self.height, 0, layout, GL.GL_FLOAT, None)
        GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, attachment, GL.GL_TEXTURE_2D, texture, 0)

    def begin(self) -> None:
        """Clear the picture and direct drawing into it."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        GL.glViewport(0, 0, self.width, self.height)
        GL.glDepthMask(GL.GL_TRUE)
        for index, output in enumerate(self.outputs):
            GL.glClearBufferfv(GL.GL_COLOR, index, np.full(4, CLEARED[output], np.float32))
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.full(1, FAR, np.float32))

    def keep_geometry(self, keep: bool) -> None:
        """Disable writes of depth and motion, or (False) enable them."""
        write = GL.GL_FALSE if keep else GL.GL_TRUE
        GL.glDepthMask(write)
        if "motion" in self.outputs:
            GL.glColorMaski(self.outputs.index("motion"), write, write, write, write)

    def read(self, output: str) -> NDArray[np.float32]:
        """Read one output [H, W] or [H, W, C], row 0 at the top: the only place that flips OpenGL's rows."""
        _, layout, channels = FORMATS[output]
        self.choose(output)
        shape = (self.height, self.width) if channels == 1 else (self.height, self.width, channels)
        return self._read(layout, np.empty(shape, np.float32))

    def read_depth(self) -> NDArray[np.float32]:
        """Read reversed device depth [H, W], row 0 at the top."""
        return self._read(GL.GL_DEPTH_COMPONENT, np.empty((self.height, self.width), np.float32))

    def choose(self, output: str) -> None:
        """Select ``output`` for the next read."""
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._framebuffer)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + self.outputs.index(output))

    def _read(self, layout: int, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._framebuffer)
        GL.glReadPixels(0, 0, self.width, self.height, layout, GL.GL_FLOAT, pixels)
        return pixels[::-1]

    def delete(self) -> None:
        """Free the framebuffer and its textures."""
        GL.glDeleteFramebuffers(1, [self._framebuffer])
        GL.glDeleteTextures(self._textures)


class Readback:
    """Reads one output of a target asynchronously: several pictures are in flight before it waits for the first.

    Waiting for each picture at once would leave a GPU idle, and make it switch between the contexts of several
    processes at every picture.
    """

    def __init__(self, target: Target, output: str) -> None:
        """Allocate as many driver buffers as fit into WAITING_BYTES, at least one and at most MOST_WAITING."""
        _, self._layout, channels = FORMATS[output]
        self._target, self._output = target, output
        self._shape = (target.height, target.width, channels)
        self._bytes = 4 * int(np.prod(self._shape))
        depth = max(1, min(MOST_WAITING, WAITING_BYTES // self._bytes))
        self._free = [int(name) for name in np.atleast_1d(GL.glGenBuffers(depth))]
        self._waiting: deque[int] = deque()
        for name in self._free:
            GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, name)
            GL.glBufferData(GL.GL_PIXEL_PACK_BUFFER, self._bytes, None, GL.GL_STREAM_READ)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)

    def each(self, drawings: Iterable[Callable[[], None]]) -> Iterator[NDArray[np.float32]]:
        """Draw into the target repeatedly; yields the pixels [H, W, C] of each drawing, in order, row 0 at the top.

        An array is valid only until the next one is requested.
        """
        for draw in drawings:
            draw()
            self._begin()
            if not self._free:
                yield from self._finish()
        while self._waiting:
            yield from self._finish()

    def _begin(self) -> None:
        name = self._free.pop()
        self._target.choose(self._output)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, name)
        GL_1_0.glReadPixels(0, 0, self._target.width, self._target.height, self._layout, GL.GL_FLOAT, None)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)
        self._waiting.append(name)

    def _finish(self) -> Iterator[NDArray[np.float32]]:
        """Wait for the oldest picture and yield it in the driver's memory, valid until the generator resumes."""
        name = self._waiting.popleft()
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, name)
        address = GL_1_5.glMapBuffer(GL.GL_PIXEL_PACK_BUFFER, GL.GL_READ_ONLY)
        pixels = np.ctypeslib.as_array((ctypes.c_float * (self._bytes // 4)).from_address(address))
        yield pixels.reshape(self._shape)[::-1]
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, name)
        GL.glUnmapBuffer(GL.GL_PIXEL_PACK_BUFFER)
        GL.glBindBuffer(GL.GL_PIXEL_PACK_BUFFER, 0)
        self._free.append(name)

    def delete(self) -> None:
        """Free the buffers."""
        GL.glDeleteBuffers(len(self._free), self._free)
