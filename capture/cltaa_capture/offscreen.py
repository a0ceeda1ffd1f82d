"""Off-screen OpenGL without a display, by EGL: surfaceless, or on a device.

PyOpenGL binds to its platform on its first import, so ``open_context`` must run before any ``import OpenGL``. pyrender
0.1.45 pins PyOpenGL 3.1.0; ``_mend_pyrender`` supplies the four things that this pair lacks.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
import types
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.errors import DeviceMissing, UsageError

INSTALL = "install libegl1, libegl-mesa0 and libgl1 (Debian, Ubuntu: apt-get install libegl1 libegl-mesa0 libgl1)"

# Names of the shared libraries, newest first.
LIBRARIES = {
    "EGL": ("libEGL.so.1", "libEGL.so"),
    "GL": ("libGL.so.1", "libGL.so"),
}

EGL_PLATFORM_SURFACELESS_MESA = 0x31DD  # EGL_MESA_platform_surfaceless
EGL_DEVICE = "EGL_DEVICE_ID"  # environment variable that chooses among several cards; pyrender reads it too


def _first_library(names: tuple[str, ...]) -> str | None:
    """Return the first shared library of ``names`` that can be loaded."""
    for name in names:
        try:
            ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
        return name
    return None


def choose_egl() -> None:
    """Let PyOpenGL bind to EGL; raises DeviceMissing where it cannot be loaded, UsageError where PyOpenGL is bound to
    something else."""
    bound = os.environ.get("PYOPENGL_PLATFORM") if "OpenGL" in sys.modules else None
    if bound == "egl":
        return
    if "OpenGL" in sys.modules:
        raise UsageError(f"OpenGL is already bound to {bound or 'a display'}", cure="capture in a new process")
    if not _first_library(LIBRARIES["EGL"]):
        raise DeviceMissing("no off-screen OpenGL: EGL cannot be loaded", cure=INSTALL)
    os.environ["PYOPENGL_PLATFORM"] = "egl"


def _mend_pyrender() -> None:
    """Supply what pyrender 0.1.45 with PyOpenGL 3.1.0 lacks; safe to call twice."""
    if not hasattr(np, "infty"):  # removed in NumPy 2; pyrender uses it for bounds
        setattr(np, "infty", np.inf)  # noqa: B010 (NumPy's types know of no such name)
    # pyrender's viewer, unused here, needs pyglet and an X server.
    viewer: Any = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None
    sys.modules.setdefault("pyrender.viewer", viewer)
    _mend_loader()
    _mend_arguments()


def _mend_loader() -> None:
    """Let PyOpenGL find libraries by our names first, during its import and later.

    By itself it asks only the linker's cache, which lacks LD_LIBRARY_PATH and libraries without a development link.
    """
    find = ctypes.util.find_library

    def found(name: str) -> str | None:
        return _first_library(LIBRARIES.get(name, ())) or find(name)

    ctypes.util.find_library = found
    try:
        from OpenGL.platform import ctypesloader
    finally:
        ctypes.util.find_library = find
    ctypesloader.util = types.SimpleNamespace(find_library=found)  # for libraries that it loads later


def _mend_arguments() -> None:
    """Register the new name of ctypes.byref's type in Python 3.13; PyOpenGL 3.1.0 finds handlers by type name."""
    from OpenGL.plugins import FormatHandler

    by_reference = type(ctypes.byref(ctypes.c_int()))
    name = f"{by_reference.__module__}.{by_reference.__name__}"
    handler = FormatHandler.by_name("ctypesparameter")
    if name not in handler.check:
        handler.check = [*handler.check, name]


@dataclass(slots=True)
class Context:
    """A current OpenGL context; ``close`` it after deleting every object in it."""

    version: str  # GL_VERSION
    renderer: str  # GL_RENDERER
    _platform: Any

    def close(self) -> None:
        """Destroy the context."""
        self._platform.delete_context()


def open_context() -> Context:
    """Open an off-screen OpenGL context and make it current; raises DeviceMissing if there is none."""
    choose_egl()
    if sys.flags.optimize:
        cure = "run it without python -O and without the variable PYTHONOPTIMIZE"
        raise DeviceMissing("no off-screen OpenGL: pyrender opens it in assertions, which -O leaves out", cure=cure)
    try:
        _mend_pyrender()
        platform = _started(_egl_platforms())
        from OpenGL import GL

        strings = [GL.glGetString(name) for name in (GL.GL_VERSION, GL.GL_RENDERER)]
    except (ImportError, AttributeError, AssertionError, OSError, RuntimeError) as error:
        reason = str(error) or type(error).__name__
        raise DeviceMissing(f"no off-screen OpenGL: EGL gave no context ({reason})", cure=INSTALL) from error
    if None in strings:
        raise DeviceMissing("no off-screen OpenGL: EGL gave no current context", cure=INSTALL)
    version, renderer = (string.decode() for string in strings)
    return Context(version, renderer, platform)


def _egl_platforms() -> Iterator[Any]:
    """Yield pyrender's EGL platform on displays that need no X server: surfaceless, then each EGL device.

    Mesa supports the first; NVIDIA's driver only the second (EGL_EXT_platform_device). A number in EGL_DEVICE_ID
    restricts it to that device. Raises UsageError if that device does not exist.
    """
    from pyrender.platforms import egl

    number = os.environ.get(EGL_DEVICE)
    if number is not None:
        devices = egl.query_devices()
        if not number.isdecimal() or int(number) >= len(devices):
            expected = f"0 to {len(devices) - 1}" if devices else "unset: EGL knows no devices here"
            raise UsageError(f"{EGL_DEVICE} names no device of EGL", expected=expected, found=number)
        yield egl.EGLPlatform(1, 1, device=devices[int(number)])
        return

    class Surfaceless(egl.EGLDevice):  # type: ignore[misc]
        def get_display(self) -> Any:
            return egl._eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, None, None)

    yield egl.EGLPlatform(1, 1, device=Surfaceless())
    for device in egl.query_devices():
        yield egl.EGLPlatform(1, 1, device=device)


def _started(platforms: Iterable[Any]) -> Any:
    """Return the first platform that gives a context, made current; raises RuntimeError with the last error."""
    from OpenGL.error import Error

    failure: Exception | None = None
    for platform in platforms:
        try:
            platform.init_context()
            platform.make_current()
        except (AssertionError, Error) as error:
            failure = error
        else:
            return platform
    raise RuntimeError(str(failure) or type(failure).__name__) from failure
