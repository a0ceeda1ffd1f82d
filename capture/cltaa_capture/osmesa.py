"""Off-screen OpenGL without a display: OSMesa if it can be loaded, else EGL, surfaceless or on a device.

PyOpenGL binds to its platform on its first import, so ``choose_backend`` must run before any ``import OpenGL``.
pyrender 0.1.45 pins PyOpenGL 3.1.0; ``_mend_pyrender`` supplies the five things that this pair lacks.
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

BACKENDS = ("auto", "osmesa", "egl")
INSTALL = "install libosmesa6 (Debian, Ubuntu: apt-get install libosmesa6), or libegl1, libegl-mesa0 and libgl1"

# Names of the shared libraries, newest first.
LIBRARIES = {
    "OSMesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
    "EGL": ("libEGL.so.1", "libEGL.so"),
    "GL": ("libGL.so.1", "libGL.so"),
}

# GL/osmesa.h
OSMESA_CONSTANTS = {
    "OSMESA_DEPTH_BITS": 0x30,
    "OSMESA_PROFILE": 0x33,
    "OSMESA_CORE_PROFILE": 0x34,
    "OSMESA_CONTEXT_MAJOR_VERSION": 0x36,
    "OSMESA_CONTEXT_MINOR_VERSION": 0x37,
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


def choose_backend(backend: str = "auto") -> str:
    """Choose ``osmesa`` or ``egl`` and configure PyOpenGL; raises DeviceMissing if neither can be loaded."""
    if backend not in BACKENDS:
        raise UsageError(f"no such backend: {backend}", cure=f"use one of {', '.join(BACKENDS)}")
    bound = os.environ.get("PYOPENGL_PLATFORM") if "OpenGL" in sys.modules else None
    if bound is not None and backend in ("auto", bound):
        return bound
    if "OpenGL" in sys.modules:
        raise UsageError(
            f"OpenGL is already bound to {bound or 'a display'}", cure="choose the backend in a new process"
        )
    if backend in ("auto", "osmesa") and _first_library(LIBRARIES["OSMesa"]):
        chosen = "osmesa"
    elif backend in ("auto", "egl") and _first_library(LIBRARIES["EGL"]):
        chosen = "egl"
    else:
        wanted = "OSMesa or EGL" if backend == "auto" else {"osmesa": "OSMesa", "egl": "EGL"}[backend]
        raise DeviceMissing(f"no off-screen OpenGL: {wanted} cannot be loaded", cure=INSTALL)
    os.environ["PYOPENGL_PLATFORM"] = chosen
    return chosen


def _mend_pyrender(backend: str) -> None:
    """Supply what pyrender 0.1.45 with PyOpenGL 3.1.0 lacks; safe to call twice."""
    if not hasattr(np, "infty"):  # removed in NumPy 2; pyrender uses it for bounds
        setattr(np, "infty", np.inf)  # noqa: B010 (NumPy's types know of no such name)
    # pyrender's viewer, unused here, needs pyglet and an X server.
    viewer: Any = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None
    sys.modules.setdefault("pyrender.viewer", viewer)
    _mend_loader()
    _mend_arguments()
    if backend == "osmesa":
        _mend_osmesa()
    import OpenGL.contextdata as contextdata

    if not hasattr(contextdata, "cltaa_get_context"):
        contextdata.cltaa_get_context = contextdata.getContext
        contextdata.getContext = _hashable_context


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


def _hashable_context(context: Any = None) -> int:
    """Return the context's address, because OSMesa returns a new pointer object on each call, useless as a key."""
    import OpenGL.contextdata as contextdata

    pointer = contextdata.cltaa_get_context(context)
    return pointer if isinstance(pointer, int) else ctypes.cast(pointer, ctypes.c_void_p).value or 0


def _mend_arguments() -> None:
    """Register the new name of ctypes.byref's type in Python 3.13; PyOpenGL 3.1.0 finds handlers by type name."""
    from OpenGL.plugins import FormatHandler

    by_reference = type(ctypes.byref(ctypes.c_int()))
    name = f"{by_reference.__module__}.{by_reference.__name__}"
    handler = FormatHandler.by_name("ctypesparameter")
    if name not in handler.check:
        handler.check = [*handler.check, name]


def _mend_osmesa() -> None:
    """Declare OSMesaCreateContextAttribs, which PyOpenGL 3.1.0 lacks."""
    import OpenGL.osmesa as osmesa
    from OpenGL import platform as gl_platform

    if not hasattr(osmesa, "OSMesaCreateContextAttribs"):
        create = gl_platform.PLATFORM.OSMesa.OSMesaCreateContextAttribs
        create.restype = osmesa.OSMesaContext
        create.argtypes = [ctypes.POINTER(ctypes.c_int), osmesa.OSMesaContext]
        osmesa.OSMesaCreateContextAttribs = lambda attributes, share: create(
            (ctypes.c_int * len(attributes))(*map(int, attributes)), share
        )
    for name, value in OSMESA_CONSTANTS.items():
        if not hasattr(osmesa, name):
            setattr(osmesa, name, value)


@dataclass(slots=True)
class Context:
    """A current OpenGL context; ``close`` it after deleting every object in it."""

    backend: str  # osmesa or egl
    version: str  # GL_VERSION
    renderer: str  # GL_RENDERER
    _platform: Any

    def close(self) -> None:
        """Destroy the context."""
        self._platform.delete_context()


def open_context(backend: str = "auto") -> Context:
    """Open an off-screen OpenGL context and make it current; raises DeviceMissing if there is none."""
    chosen = choose_backend(backend)
    if sys.flags.optimize:
        cure = "run it without python -O and without the variable PYTHONOPTIMIZE"
        raise DeviceMissing("no off-screen OpenGL: pyrender opens it in assertions, which -O leaves out", cure=cure)
    try:
        _mend_pyrender(chosen)
        platform = _started(_egl_platforms() if chosen == "egl" else [_osmesa_platform()])
        from OpenGL import GL

        strings = [GL.glGetString(name) for name in (GL.GL_VERSION, GL.GL_RENDERER)]
    except (ImportError, AttributeError, AssertionError, OSError, RuntimeError) as error:
        reason = str(error) or type(error).__name__
        raise DeviceMissing(f"no off-screen OpenGL: {chosen} gave no context ({reason})", cure=INSTALL) from error
    if None in strings:
        raise DeviceMissing(f"no off-screen OpenGL: {chosen} gave no current context", cure=INSTALL)
    version, renderer = (string.decode() for string in strings)
    return Context(chosen, version, renderer, platform)


def _osmesa_platform() -> Any:
    """Return pyrender's OSMesa platform, with one pixel because its own buffer is never drawn to."""
    from pyrender.platforms.osmesa import OSMesaPlatform

    return OSMesaPlatform(1, 1)


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
