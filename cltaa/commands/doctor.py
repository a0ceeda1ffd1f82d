"""``cltaa doctor``: probe what capture and resolve need on this machine; every failure comes with its cure.

A badly set up driver may end the whole process (PoCL without a linker does), and a process can choose only once
between OSMesa and EGL. So each probe runs in its own process: ``python -m cltaa.commands.doctor NAME [ARGUMENT]``
prints its finding as one line of JSON.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
from rich.table import Table

from cltaa.commands.options import json_option
from cltaa.commands.printing import Console
from cltaa.errors import CltaaError, DeviceMissing, InternalError, UsageError
from cltaa.opencl import cache as kernel_cache
from cltaa.opencl.pocl_cpu_name import cpu_facts, cpu_flags, cpu_name, level_of
from cltaa.printable import counted, json_of, shown
from cltaa.process import configure

# A cold build of every kernel takes about 10 s on one core, and 60 s on a core shared by ten processes. A probe that
# takes far longer hangs.
PROBE_SECONDS = 600

LINKER_CURE = "sudo apt-get install -y gcc libc6-dev"
DRIVERS_CURE = "install the library that it lacks or name its folder in LD_LIBRARY_PATH, or remove the file"
LONGEST_PATH = 4096  # PATH_MAX of Linux
OPENCL_CURE = "python -m pip install 'pyopencl[pocl]'"
ENDING_DRIVER_CURE = (
    "leave out the driver that ends the program: OCL_ICD_VENDORS=DIR makes OpenCL read only the .icd files of DIR"
)
OSMESA_CURE = "sudo apt-get install -y libosmesa6"
EGL_CURE = "sudo apt-get install -y libegl1 libegl-mesa0 libgl1"
RESOLVE_CURE = "see to the lines above first, else try another device; cltaa resolve --debug shows the whole error"
ABORT_CURE = (
    "see to the lines above first; else --device numpy does without a driver (slowly), another OpenCL driver may do; "
    "a report of this should hold the whole table"
)
KEPT_CURE = "what was built earlier is at fault: remove the folder of the kernel cache"
PACKAGES_CURE = "sh scripts/setup, or python -m pip install 'cltaa[all]'"


class Finding(msgspec.Struct, frozen=True):
    """Result of one probe: ``found`` says what exists or what went wrong, ``cure`` what to do if it is not ``ok``.

    ``serves`` is the part that needs it: "capture", "resolve" or "both". ``died``: the driver ended the probe.
    """

    name: str
    serves: str
    ok: bool
    found: str
    cure: str | None = None
    devices: list[dict[str, object]] = []
    died: bool = False


class Diagnosis(msgspec.Struct, frozen=True):
    """All findings, and whether capture and resolve work."""

    capture: bool
    resolve: bool
    findings: list[Finding]

    def hurts(self, finding: Finding) -> bool:
        """Return True if the part that the finding serves fails; without EGL, say, capture may still use OSMesa."""
        works = {"capture": self.capture, "resolve": self.resolve, "both": self.capture and self.resolve}
        return not finding.ok and not works[finding.serves]


def diagnose() -> Diagnosis:
    """Run all probes in parallel and return the findings in a fixed order."""
    python = f"{platform.python_version()} on {platform.platform(terse=True)}"  # an older Python cannot have cltaa
    looks: list[Callable[[], Finding]] = [
        lambda: Finding("Python", "both", ok=True, found=python),
        look_at_processor,
        lambda: probe("EXR files", "both", PACKAGES_CURE, "files"),
        look_at_linker,
        lambda: probe("kernel cache", "resolve", kernel_cache.CURE, "cache"),
        look_at_drivers,
        look_at_devices,
        look_at_resolve,
        lambda: probe("capture on OSMesa", "capture", OSMESA_CURE, "capture", "osmesa"),
        lambda: probe("capture on EGL", "capture", EGL_CURE, "capture", "egl"),
    ]
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        findings = list(pool.map(lambda look: look(), looks))
    ok = {finding.name: finding.ok for finding in findings}
    return Diagnosis(
        capture=ok["EXR files"] and (ok["capture on OSMesa"] or ok["capture on EGL"]),
        resolve=ok["EXR files"] and ok["resolve"],
        findings=findings,
    )


def probe(name: str, serves: str, cure: str, *arguments: str, **environment: str) -> Finding:
    """Run a probe with its arguments in a separate process, which may die, and return its finding."""
    command = [sys.executable, "-m", "cltaa.commands.doctor", *arguments]
    try:
        child = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=PROBE_SECONDS,
            check=False,
            env=os.environ | environment,
        )
    except subprocess.TimeoutExpired:
        return Finding(name, serves, ok=False, found=f"no answer in {PROBE_SECONDS} s", cure=cure)
    if child.returncode:
        if child.returncode == UsageError.exit_code:  # a Python package is missing; the driver is not at fault
            cure = PACKAGES_CURE
        died = child.returncode < 0
        found = why_it_died(child.stderr, -child.returncode) if died else _last_line(child.stderr, child.returncode)
        return Finding(name, serves, ok=False, found=found, cure=cure, died=died)
    answer = json.loads(child.stdout.splitlines()[-1])
    if isinstance(answer, str):
        return Finding(name, serves, ok=True, found=answer)
    first = f", first {answer[0]['device']} ({answer[0]['driver']})" if answer else ""
    return Finding(name, serves, ok=bool(answer), found=f"{len(answer)} found{first}", cure=cure, devices=answer)


def _last_line(said: str, code: int) -> str:
    lines = [line for line in said.splitlines() if line.strip()]
    return lines[-1].removeprefix("cltaa: error: ") if lines else f"ended with {code}"


def why_it_died(said: str, number: int) -> str:
    """Return the line in which a driver that ended its process says why, and the signal.

    It is seldom the last line: LLVM then prints the function, and PoCL the objects that it still holds.
    """
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for mark in ("LLVM ERROR", "error:") for line in lines if mark in line] or lines
    return " ".join([*telling[:1], f"(ended by {signal.Signals(number).name})"])


def look_at_devices() -> Finding:
    """List the devices. If a driver ends the process no other is missing, and without it the rest may work."""
    found = probe("OpenCL devices", "resolve", OPENCL_CURE, "devices")
    return msgspec.structs.replace(found, cure=ENDING_DRIVER_CURE) if found.died else found


def look_at_resolve() -> Finding:
    """Resolve with the cached kernels; if that ends the process, again with an empty cache.

    The remains of an aborted build in the cache would make the driver report another error the second time.
    """
    kept = probe("resolve", "resolve", RESOLVE_CURE, "resolve")
    if not kept.died:
        return kept
    with tempfile.TemporaryDirectory() as empty:
        anew = probe("resolve", "resolve", ABORT_CURE, "resolve", POCL_CACHE_DIR=empty)
    return msgspec.structs.replace(kept, cure=KEPT_CURE) if anew.ok else anew


def look_at_processor() -> Finding:
    """Name the processor, and on x86-64 its level, the build target of kernels if PoCL does not know the processor."""
    told, words = cpu_facts(), [cpu_name()]
    words += [f"{key.removeprefix('cpu ')} {told[key]}" for key in ("cpu family", "model") if key in told]
    words += [level_of(cpu_flags()).name.decode()] * (platform.machine() == "x86_64")
    return Finding("processor", "both", ok=True, found=", ".join([*words, counted(os.cpu_count() or 1, "core")]))


def look_at_linker() -> Finding:
    """Link a shared object against the C library, as PoCL does for every kernel."""
    name = "linker and C files"
    compiler = shutil.which("gcc")
    if compiler is None or shutil.which("ld") is None:
        return Finding(name, "resolve", ok=False, found="gcc or ld is not in PATH", cure=LINKER_CURE)
    with tempfile.TemporaryDirectory() as folder:
        command = [compiler, "-shared", "-x", "c", "-o", str(Path(folder, "probe.so")), "-"]
        source = "#include <math.h>\nint probe(void) { return 0; }\n"
        child = subprocess.run(command, input=source, capture_output=True, text=True, errors="replace", check=False)
    if child.returncode:
        found = _last_line(child.stderr, child.returncode)
        return Finding(name, "resolve", ok=False, found=found, cure=LINKER_CURE)
    return Finding(name, "resolve", ok=True, found=f"{compiler} links")


def look_at_drivers() -> Finding:
    """Load each OpenCL driver that is installed here: OpenCL's loader says nothing of one that it cannot load."""
    folder = Path(os.environ.get("OCL_ICD_VENDORS") or "/etc/OpenCL/vendors")
    entries = sorted(folder.glob("*.icd"))
    failed = [f"{entry}: {fault}" for entry in entries if (fault := _fault_of_driver(entry))]
    found = "; ".join(failed) or f"{len(entries)} in {folder}, beside those of wheels"
    return Finding("OpenCL drivers", "resolve", ok=not failed, found=found, cure=DRIVERS_CURE)


def _fault_of_driver(entry: Path) -> str:
    """Return why the driver that a file names cannot be loaded; empty if it can."""
    try:
        library = os.fsdecode(entry.read_bytes()).strip() if entry.is_file() else ""  # a pipe would never end
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if not library.isprintable() or not 0 < len(library) <= LONGEST_PATH:
        return "holds no path of a library"
    loads = [sys.executable, "-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", library]
    child = subprocess.run(loads, capture_output=True, text=True, errors="replace", check=False)
    return _last_line(child.stderr, child.returncode).removeprefix("OSError: ") if child.returncode else ""


@click.command()
@json_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool) -> None:
    """Look for what capture and resolve need on this machine.

    Each probe runs in its own process, so that a driver that aborts costs only one line of the table. Each failure
    comes with its cure. Capture needs either OSMesa or EGL. The exit code is 0 if capture and resolve both work, else
    69.
    """
    console = Console(stderr=as_json)
    with console.status("Trying files, linker, OpenCL and OpenGL ..."):
        diagnosis = diagnose()
    if as_json:
        click.echo(json_of(diagnosis))
    else:
        console.print(_findings(diagnosis))
        for devices in filter(None, (finding.devices for finding in diagnosis.findings)):
            console.print(_devices(devices))
    if not (diagnosis.capture and diagnosis.resolve):
        ctx.exit(DeviceMissing.exit_code)


def _findings(diagnosis: Diagnosis) -> Table:
    verdict = ", ".join(
        f"{name} [green]works[/]" if works else f"{name} [red]does not work[/]"
        for name, works in (("capture", diagnosis.capture), ("resolve", diagnosis.resolve))
    )
    spare = any(not finding.ok and not diagnosis.hurts(finding) for finding in diagnosis.findings)
    caption = "–: does not work, and is not needed" if spare else None
    table = Table(title=f"cltaa doctor: {verdict}", title_justify="left", caption=caption, caption_justify="left")
    for heading in ("", "looked for", "found", "cure"):
        table.add_column(heading, overflow="fold")
    for finding in diagnosis.findings:
        mark = "[green]✓[/]" if finding.ok else "[red]✗[/]" if diagnosis.hurts(finding) else "[yellow]–[/]"
        cure = "" if finding.ok or finding.cure is None else finding.cure
        table.add_row(mark, finding.name, shown(finding.found), shown(cure))
    return table


def _devices(devices: list[dict[str, object]]) -> Table:
    title = "OpenCL devices, in the order of choice; CLTAA_DEVICE or --device names another"
    table = Table("", title=title, title_justify="left")
    for index in range(len(devices)):
        table.add_column(f"--device {index}")
    for name in devices[0]:
        heading = name.removesuffix("_bytes").replace("_", " ")
        table.add_row(heading, *(_cell(name, device[name]) for device in devices))
    return table


def _cell(name: str, value: object) -> str:
    if isinstance(value, bool):
        return "[green]yes[/]" if value else "[dim]no[/]"
    if isinstance(value, list):
        return shown(", ".join(value) or "none")
    if name.endswith("_bytes") and isinstance(value, int):
        return f"{value / 2**30:.1f} GiB"
    return shown(str(value))


# Bits of cl_device_fp_config (OpenCL 1.2, table 4.3).
FP_DENORM = 1 << 0
FP_CORRECTLY_ROUNDED_DIVIDE_SQRT = 1 << 7

# Prefixes of the extensions that share memory and semaphores with Vulkan, CUDA, OpenGL and other devices (OpenCL 3.0
# Extension Specification; Arm's own).
EXTERNAL = ("cl_khr_external_", "cl_khr_gl_", "cl_khr_egl_", "cl_arm_import_memory")

# Large enough to run every lane of a CPU kernel and its remainder, small enough to cost nothing.
WIDTH, HEIGHT = 40, 24


def _try_files() -> str:
    """Write an EXR, read it back and compare; return the version of OpenEXR."""
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


def _try_cache() -> str:
    """Write into the folder where the driver caches built kernels, and return it with its free space."""
    import_module("cltaa.opencl.device")  # sets the folder
    try:
        return f"{kernel_cache.cache_folder()}, {kernel_cache.check_cache() / 1e9:.1f} GB free"
    except CltaaError as error:
        raise SystemExit(f"{error.path}: {error.what}") from None


def _try_devices() -> list[dict[str, object]]:
    """Return the properties of each OpenCL device, in the order of choice."""
    from cltaa.opencl.device import chosen_shape, devices

    return [_facts(device) | {"shape": ", ".join(chosen_shape(device))} for device in devices()]


def _facts(device: Any) -> dict[str, object]:
    extensions = device.extensions.split()
    return {
        "device": device.name.strip(),
        "platform": device.platform.name.strip(),
        "version": device.platform.version.strip(),
        "driver": device.driver_version.strip(),
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


def _try_resolve() -> str:
    """Build the kernels of two presets, resolve three frames of a turn, and compare the last with the oracle's."""
    from cltaa.core.resolver import Resolver
    from cltaa.lab.bench.devices import PROOF_SIZE, PROVEN, last_image
    from cltaa.lab.bench.kernels import check_same
    from cltaa.lab.timing import Motion, make_frames

    frames = make_frames(*PROOF_SIZE, Motion.TURN)
    for preset in PROVEN:
        resolver, oracle = Resolver(preset), Resolver(preset, "numpy")
        device = resolver.launcher.description
        try:
            check_same(preset, last_image(resolver, frames), last_image(oracle, frames), border=0)
        except InternalError as error:
            raise SystemExit(f"preset {preset} on {device}: {error.found} of the pixels are not the oracle's") from None
    return f"resolved three frames on {device}"


def _try_capture(backend: str) -> str:
    """Draw one frame of a scene with ``cltaa capture`` on one back end and return its OpenGL version."""
    from cltaa.cli import main

    with tempfile.TemporaryDirectory() as folder:
        arguments = ["still", "-o", folder, "--frames", "1", "--size", f"{WIDTH}x{HEIGHT}", "--backend", backend]
        code = main(["capture", *arguments, "--reference", "0"])
        if code:
            raise SystemExit(code)
        asked: Mapping[str, Any] = json.loads(Path(folder, "sequence.json").read_text())
    return str(asked.get("versions", {}).get("opengl", "drew one frame"))


PROBES: dict[str, Callable[..., object]] = {
    "cache": _try_cache,
    "capture": _try_capture,
    "devices": _try_devices,
    "files": _try_files,
    "resolve": _try_resolve,
}


def _run_probe(name: str, *arguments: str) -> None:
    """Run one probe; an error ends the process with one line on standard error."""
    try:
        found = PROBES[name](*arguments)
    except CltaaError as error:
        raise SystemExit(str(error)) from None
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    configure()
    _run_probe(*sys.argv[1:])
