"""One probe a child process: ``python -m cltaa.probes NAME [ARGUMENT]`` prints what it found as one line of JSON.

``cltaa doctor`` starts these, because a driver that is not set up right may end the whole process (PoCL without a
linker does) and because a choice such as OSMesa or EGL can be made once a process.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cltaa.errors import CltaaError
from cltaa.frame import Camera, Frame
from cltaa.opencl.cache import cache_folder, check_cache
from cltaa.process import configure

# Bits of cl_device_fp_config (OpenCL 1.2, table 4.3).
FP_DENORM = 1 << 0
FP_CORRECTLY_ROUNDED_DIVIDE_SQRT = 1 << 7

# How the names of extensions begin by which a driver takes memory of Vulkan, CUDA, OpenGL and other devices, and waits
# for it (OpenCL 3.0 Extension Specification; that of Arm).
EXTERNAL = ("cl_khr_external_", "cl_khr_gl_", "cl_khr_egl_", "cl_arm_import_memory")

# Large enough that every lane of a CPU kernel and its remainder run, small enough to cost nothing.
WIDTH, HEIGHT = 40, 24


def files() -> str:
    """Write an EXR, read it back and compare; return the version of OpenEXR."""
    from importlib.metadata import version

    from cltaa.io.exr_read import read_image
    from cltaa.io.exr_write import write_image

    written = np.random.default_rng(0).random((HEIGHT, WIDTH), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "probe.exr")
        write_image(path, {"Y": written})
        channels, _ = read_image(path)
    if not np.array_equal(channels["Y"], written):
        raise SystemExit("OpenEXR does not read back what it wrote")
    return f"OpenEXR {version('OpenEXR')}, read back what it wrote"


def cache() -> str:
    """Write into the folder where the driver keeps built kernels, and look at the space left there."""
    importlib.import_module("cltaa.opencl.device")  # decides where that folder is
    try:
        return f"{cache_folder()}, {check_cache() / 1e9:.1f} GB free"
    except CltaaError as error:
        raise SystemExit(f"{error.path}: {error.what}") from None


def devices() -> list[dict[str, object]]:
    """Return what each OpenCL device can do, in the order in which they are chosen from."""
    from cltaa.opencl.device import chosen_shape
    from cltaa.opencl.device import devices as found

    return [_facts(device) | {"shape": ", ".join(chosen_shape(device))} for device in found()]


def _facts(device: Any) -> dict[str, object]:
    extensions = device.extensions.split()
    return {
        "device": device.name.strip(),
        "platform": device.platform.name.strip(),
        "driver": device.platform.version.strip(),
        "language": device.opencl_c_version.strip(),
        "compute_units": device.max_compute_units,
        "memory_bytes": device.global_mem_size,
        "largest_buffer_bytes": device.max_mem_alloc_size,
        "fp64": "cl_khr_fp64" in extensions,
        "fp16": "cl_khr_fp16" in extensions,
        "denormals": bool(device.single_fp_config & FP_DENORM),
        "rounded_divide": bool(device.single_fp_config & FP_CORRECTLY_ROUNDED_DIVIDE_SQRT),
        "external_memory": sorted(name for name in extensions if name.startswith(EXTERNAL)),
    }


def resolve() -> str:
    """Build the production kernel, resolve three frames of noise and look at the result."""
    from cltaa.core.resolver import Resolver

    resolver = Resolver()
    random = np.random.default_rng(0)
    camera = Camera(world_to_view=np.eye(4), view_to_clip=_projection())
    for index in range(3):
        colour = np.moveaxis(random.random((3, HEIGHT, WIDTH), np.float32), 0, -1)
        frame = Frame(index=index, colour=colour, depth=np.ones((HEIGHT, WIDTH), np.float32), camera=camera)
        resolved = resolver.resolve(frame)
        if resolved.shape != colour.shape or not (resolved.min() >= 0.0 and resolved.max() <= 1.0):
            raise SystemExit("the resolve of three frames of noise in [0, 1] is not in [0, 1]")
    return "resolved three frames"


def _projection() -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return an OpenGL perspective projection, 90 degrees across, near 0.1, far 100."""
    near, far = 0.1, 100.0
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 1.0, WIDTH / HEIGHT
    matrix[2, 2], matrix[2, 3] = (far + near) / (near - far), 2.0 * far * near / (near - far)
    matrix[3, 2] = -1.0
    return matrix


def capture(backend: str) -> str:
    """Draw one frame of a scene with ``cltaa capture`` on one back end and return what drew it."""
    from cltaa.cli import main

    with tempfile.TemporaryDirectory() as folder:
        arguments = ["still", "-o", folder, "--frames", "1", "--size", f"{WIDTH}x{HEIGHT}", "--backend", backend]
        code = main(["capture", *arguments, "--reference", "0"])
        if code:
            raise SystemExit(code)
        asked: Mapping[str, Any] = json.loads(Path(folder, "sequence.json").read_text())
    return str(asked.get("versions", {}).get("opengl", "drew one frame"))


PROBES: dict[str, Callable[..., object]] = {
    "cache": cache,
    "capture": capture,
    "devices": devices,
    "files": files,
    "resolve": resolve,
}


def main(name: str, *arguments: str) -> None:
    """Run one probe; what goes wrong ends the process with one line on standard error."""
    try:
        found = PROBES[name](*arguments)
    except CltaaError as error:
        raise SystemExit(str(error)) from None
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    configure()
    main(*sys.argv[1:])
