"""A shape kept by ``cltaa bench devices``: who takes it, and that it changes no bit of a strict build."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pyopencl as cl
import pytest

from cltaa.core.build import code_sha256
from cltaa.core.resolver import Resolver
from cltaa.lab.timing import Motion, make_frames
from cltaa.opencl import device
from cltaa.opencl.device import choose_device, chosen_shape, measured_on, usual_shape
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import Kept, kept_path


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = kept_path(measured_on(choose_device()))
    path.parent.mkdir(parents=True)
    return path


def kept(**changes: object) -> bytes:
    here = Kept(measured_on=measured_on(choose_device()), code=code_sha256(), shape="gpu")
    return msgspec.json.encode(msgspec.structs.replace(here, **changes))


@pytest.mark.optimised
def test_a_later_resolve_takes_it_to_the_same_bits(file: Path) -> None:
    """Of all shapes the one that is least like that of a CPU."""
    assert DeviceLauncher().device.shape.lanes > 1
    file.write_bytes(kept())
    ours, oracle = Resolver(strict=True), Resolver(device="numpy")
    images = [(ours.resolve(frame), oracle.resolve(frame)) for frame in make_frames(70, 41, Motion.TURN)]
    assert ours.last is not None
    assert ours.last.build.lanes == 1
    assert all(np.array_equal(one.view(np.uint32), other.view(np.uint32)) for one, other in images)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "damaged"),
        (b"\xff\xfe{", "damaged"),
        (b'{"shape": "gpu"}', "damaged"),
        (kept(shape=16), "damaged"),
        (kept(code="0" * 64), "measured with other kernels"),
        (kept(shape="nvidia"), "of another device"),
        (kept(measured_on={"device": "another"}), "of another device"),
        (None, "Is a directory"),
    ],
    ids=["empty", "no text", "too little", "a number", "kernels", "another kind", "another device", "a folder"],
)
def test_an_unusable_file_of_shapes_is_reported_in_one_line(
    content: bytes | None, why: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file.mkdir() if content is None else file.write_bytes(content)
    first = choose_device()
    assert {chosen_shape(first) for _ in range(2)} == {usual_shape(first)}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"cltaa: {file}: this shape of kernels is ignored: {why}; run: cltaa bench devices --device "
    )


@pytest.mark.parametrize("changed", ["runtime", "compiler", "driver", "units", "features"])
def test_it_is_kept_for_what_was_measured(changed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def path(other: bool, vendor: str = "a driver's") -> Path:
        def told(name: str) -> str:
            return f"another {name}" if other and changed == name else f"a {name}"

        monkeypatch.setattr(device, "cpu_facts", lambda: {"flags": told("features"), "vendor_id": vendor})
        platform = SimpleNamespace(name=told("runtime"), version=told("compiler"), vendor=vendor)
        facts = {"name": "D", "opencl_c_version": "1.2", "type": cl.device_type.CPU, "vendor": vendor}
        made = SimpleNamespace(
            platform=platform, driver_version=told("driver"), max_compute_units=told("units"), **facts
        )
        return kept_path(measured_on(made))  # type: ignore[arg-type]

    assert path(other=True) != path(other=False) == path(other=False, vendor="another")
