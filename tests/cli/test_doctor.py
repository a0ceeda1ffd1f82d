"""``cltaa doctor``: what it finds here, and what it says where something is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.commands import doctor
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame, Image
from cltaa.opencl import cache as kernel_cache
from cltaa.opencl.device import choose_device, chosen_shape, describe


def test_the_machine_that_runs_the_tests_can_do_both(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    findings = {finding["name"]: finding for finding in json.loads(capsys.readouterr().out)["findings"]}
    found = findings["OpenCL devices"]
    device = found["devices"][0]
    assert device["device"] in found["found"]
    assert device["driver"] in found["found"]
    assert device["fp64"] is True
    assert device["compute_units"] >= 1
    assert device["shape"] == ", ".join(chosen_shape(choose_device()))
    assert findings["resolve"]["found"] == f"resolved three frames on {describe(choose_device())}"


def test_without_a_linker_the_driver_may_abort_and_doctor_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # PoCL calls ld for every kernel that its cache does not hold, and ends the process where there is none.
    for name, value in (("PATH", tmp_path), ("POCL_CACHE_DIR", tmp_path), ("PYOPENCL_NO_CACHE", 1)):
        monkeypatch.setenv(name, str(value))
    linker, resolve = doctor.look_at_linker(), doctor.look_at_resolve()
    assert (linker.ok, linker.cure) == (False, doctor.LINKER_CURE)
    assert (resolve.ok, resolve.cure) == (False, doctor.ABORT_CURE)
    assert resolve.found.startswith('error: unable to execute command: Executable "ld"')
    assert resolve.found.endswith("(ended by SIGABRT)")
    looked = doctor.Diagnosis(capture=True, resolve=False, findings=[linker, resolve])
    monkeypatch.setattr("cltaa.commands.doctor.diagnose", lambda: looked)
    assert main(["doctor", "--json"]) == 69
    assert len(json.loads(capsys.readouterr().out)["findings"]) == 2


@pytest.mark.parametrize(
    ("script", "found"),
    [("exit 4", "ended with 4"), (r"printf 'cass\351\n' >&2; exit 1", "cass\N{REPLACEMENT CHARACTER}")],
)
def test_a_compiler_that_says_nothing_or_not_in_utf_8(
    script: str, found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("gcc", "ld"):
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert doctor.look_at_linker().found == found
    monkeypatch.setattr(sys, "executable", str(tmp_path / "gcc"))
    assert doctor.probe("x", "resolve", "do this", "files").found == found


@pytest.mark.parametrize(("rows", "value", "share"), [(slice(None), np.nan, "100.00%"), (1, 0.5, "1.11%")])
def test_doctor_rejects_an_image_that_is_not_the_oracle_s(
    rows: slice | int, value: float, share: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As Rusticl of Mesa 25.0 resolves with ``fast``: all of the right range, and the second row of the image wrong.
    def resolver_of(preset: str = "default", device: str | None = None) -> Any:
        def resolve(frame: Frame) -> Image:
            image = real.resolve(frame)
            if preset == "fast" and device is None:
                image[rows] = value
            return image

        real = Resolver(preset, "numpy")
        return SimpleNamespace(resolve=resolve, launcher=SimpleNamespace(description="a device"))

    monkeypatch.setattr("cltaa.core.resolver.Resolver", resolver_of)
    with pytest.raises(SystemExit, match=f"preset fast on a device: {share} of the pixels are not the oracle's"):
        doctor.PROBES["resolve"]()


def test_doctor_rejects_files_that_read_back_differently(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.io.exr_read.read_image", lambda _: ({"Y": np.zeros((24, 40), np.float32)}, {}))
    with pytest.raises(SystemExit, match="OpenEXR does not read back what it wrote"):
        doctor.PROBES["files"]()


def test_a_cache_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path / "file" / "cache"))
    finding = doctor.probe("kernel cache", "resolve", kernel_cache.CURE, "cache")
    assert not finding.ok
    assert finding.found == f"{tmp_path}/file/cache: the kernel cache cannot be written: Not a directory"
    assert finding.cure == kernel_cache.CURE


def test_a_probe_that_fails_gives_its_last_line_and_the_cure() -> None:
    finding = doctor.probe("x", "resolve", "do this", "nonsuch")
    assert finding == doctor.Finding("x", "resolve", ok=False, found="KeyError: 'nonsuch'", cure="do this")


def test_of_a_driver_that_dies_the_line_that_tells_why() -> None:
    said = "a remark\nLLVM ERROR: Cannot select: 0x7f: v8i32\n  0x7f: i64\nIn function: resolve\nstill has\n"
    assert doctor.why_it_died(said, 6) == "LLVM ERROR: Cannot select: 0x7f: v8i32 (ended by SIGABRT)"
    assert doctor.why_it_died("cltaa: error: gone\nstill has\n", 6) == "cltaa: error: gone (ended by SIGABRT)"
    assert doctor.why_it_died("", 11) == "(ended by SIGSEGV)"


def test_where_only_what_is_kept_ends_the_process_it_is_to_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = f"import os\nif os.environ['POCL_CACHE_DIR'] == {str(tmp_path)!r}: os.abort()\n"
    stand_in += "os.write(1, b'\"resolved\"\\n')\nos._exit(0)\n"
    (tmp_path / "sitecustomize.py").write_text(stand_in)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    finding = doctor.look_at_resolve()
    assert (finding.ok, finding.cure) == (False, doctor.KEPT_CURE)


def test_the_cure_for_a_missing_package_is_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trimesh.py").write_text("raise ModuleNotFoundError(\"No module named 'trimesh'\", name='trimesh')\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    finding = doctor.probe("capture on OSMesa", "capture", doctor.OSMESA_CURE, "capture", "osmesa")
    assert not finding.ok
    assert "the Python package trimesh is not installed" in finding.found
    assert finding.cure == doctor.PACKAGES_CURE


def test_a_driver_that_the_loader_skips_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    (tmp_path / "good.icd").write_text("libc.so.6\n")
    assert doctor.look_at_drivers().found == f"1 in {tmp_path}, beside those of wheels"
    (tmp_path / "intel.icd").write_text("libnonsuch.so\n")
    finding = doctor.look_at_drivers()
    assert (finding.ok, finding.cure) == (False, doctor.DRIVERS_CURE)
    assert finding.found.startswith(f"{tmp_path}/intel.icd: libnonsuch.so: cannot open shared object file")


def test_a_driver_that_ends_the_program_is_to_be_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # As PoCL of Debian does where /sys is not mounted: it loads, and ends the process when asked for its platform.
    source = b"#include <stdlib.h>\nvoid *clGetExtensionFunctionAddress(const char *name) { abort(); }\n"
    library = tmp_path / "ends.so"
    subprocess.run(["gcc", "-shared", "-fPIC", "-x", "c", "-o", library, "-"], input=source, check=True)
    (tmp_path / "ends.icd").write_text(f"{library}\n")
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    assert doctor.look_at_drivers().ok
    found = doctor.look_at_devices()
    assert (found.ok, found.found, found.cure) == (False, "(ended by SIGABRT)", doctor.ENDING_DRIVER_CURE)
    (tmp_path / "ends.icd").unlink()
    assert doctor.look_at_devices().ok


def test_what_holds_no_path_of_a_driver_is_named_and_the_rest_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    held = {"binary": b"\x7fELF\xff\x00", "empty": b"", "long": b"a" * 10**6, "lines": b"a\nb", "latin": b"caf\xe9"}
    for name, content in held.items():
        (tmp_path / f"{name}.icd").write_bytes(content)
    (tmp_path / "folder.icd").mkdir()
    (tmp_path / "link.icd").symlink_to("nonsuch")
    (tmp_path / "last.icd").write_text("libnonsuch.so")
    os.mkfifo(tmp_path / "pipe.icd")
    faults = dict(line.split(".icd: ", 1) for line in doctor.look_at_drivers().found.split("; "))
    assert faults.pop(f"{tmp_path}/last").startswith("libnonsuch.so: cannot open")
    expected = sorted([*held, "folder", "link", "pipe"])
    assert faults == {f"{tmp_path}/{name}": "holds no path of a library" for name in expected}


def test_a_driver_file_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    (tmp_path / "a.icd").touch()  # root may read it whatever its mode
    monkeypatch.setattr(Path, "read_bytes", Mock(side_effect=PermissionError(13, "Permission denied")))
    assert doctor.look_at_drivers().found == f"{tmp_path}/a.icd: cannot be read: Permission denied"


@pytest.mark.parametrize("works", [True, False])
def test_only_what_hurts_is_marked_as_such(
    works: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    egl = doctor.Finding("capture on EGL", "capture", ok=False, found="no libEGL")
    looked = doctor.Diagnosis(capture=works, resolve=True, findings=[egl])
    assert looked.hurts(egl) is not works
    monkeypatch.setattr("cltaa.commands.doctor.diagnose", lambda: looked)
    main(["doctor"])
    assert ("–: does not work, and is not needed" in capsys.readouterr().out) is works


@pytest.mark.parametrize(
    ("extensions", "found", "said"),
    [
        (
            "cl_khr_fp64 cl_khr_gl_sharing cl_khr_external_memory",
            ["cl_khr_external_memory", "cl_khr_gl_sharing"],
            "ry, c",
        ),
        ("cl_khr_fp64 cl_khr_global_int32_base_atomics", [], "none"),
    ],
)
def test_memory_of_others_is_told_by_the_extensions_for_it(extensions: str, found: list[str], said: str) -> None:
    platform = SimpleNamespace(name="P", version="1")
    numbers = dict.fromkeys(("max_compute_units", "global_mem_size", "max_mem_alloc_size", "single_fp_config"), 1)
    device = SimpleNamespace(
        name="D", driver_version="2", platform=platform, opencl_c_version="1.2", extensions=extensions, **numbers
    )
    facts = doctor._facts(device)
    assert facts["external_memory"] == found
    assert said in doctor._cell("external_memory", found)
