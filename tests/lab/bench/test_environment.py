"""What is kept beside the numbers."""

from __future__ import annotations

import pytest

from cltaa import __version__
from cltaa.core.build import Build, code_sha256
from cltaa.lab import timing as module
from cltaa.lab.timing import environment


def test_it_says_what_the_numbers_depend_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.lab.timing.cpu_flags", lambda: {"sve", "avx2", "hypervisor"})
    found = environment("a device", 1.25)
    assert found.cpu_flags == ["avx2", "sve"]
    assert (found.device, found.load_before, found.options) == ("a device", 1.25, [*Build().flags()])
    assert found.cores >= 1
    assert found.cpu
    assert found.kernels_sha256 == code_sha256()


def test_a_checkout_that_is_not_installed_knows_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def version(name: str) -> str:
        asked.append(name)
        return "1"

    monkeypatch.setattr(module, "version", version)
    found = environment("d", 0.0).libraries
    assert found == {"cltaa": __version__} | dict.fromkeys(module.LIBRARIES, "1")
    assert "cltaa" not in asked
