"""Channels that hold nothing, damaged ones, 8-bit sources, and files that lose precision."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.frame import Frame
from cltaa.io.exr_frame import Pixels
from cltaa.lab.check.colour import DARKEST_ENCODED, SURE_OF_CUT, check_channels, check_colour
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.report import check_folder, check_frames
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_camera, make_frame


def names(found: Iterable[Finding], *, mistakes: bool = True) -> list[str]:
    return [finding.name for finding in found if finding.mistake or not mistakes]


def frames() -> list[Frame]:
    return [make_frame(index, motion=True) for index in range(3)]


def picture(frame: Frame, value: float) -> Frame:
    return replace(frame, colour=np.broadcast_to(np.float32(value), frame.colour.shape).copy())


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("colour-constant", lambda f: picture(f, 0.5)),
        ("colour-not-finite", lambda f: picture(f, np.nan)),
        ("colour-repeated", lambda f: replace(f, colour=make_frame(0).colour)),
        ("depth-constant", lambda f: replace(f, depth=np.full_like(f.depth, 0.0))),
        ("depth-not-a-number", lambda f: replace(f, depth=np.full_like(f.depth, np.nan))),
        ("motion-constant", lambda f: replace(f, motion=np.full((f.height, f.width, 2), 0.5, np.float32))),
    ],
)
def test_channels_that_carry_nothing(name: str, spoil: Callable[[Frame], Frame]) -> None:
    assert name in names(check_channels([spoil(frame) for frame in frames()], has_camera=False, has_depth=True))


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("colour-constant", lambda f: picture(f, 0.0)),  # a black leader
        ("depth-constant", lambda f: replace(f, depth=np.full_like(f.depth, 3.0))),  # a wall before the camera
        ("depth-constant", lambda f: replace(f, depth=np.full_like(f.depth, np.inf))),  # nothing but sky
    ],
)
def test_what_may_be_all_one_is_a_question(name: str, changed: Callable[[Frame], Frame]) -> None:
    found = [*check_channels([changed(frame) for frame in frames()], has_camera=True, has_depth=True)]
    assert [(finding.name, finding.mistake, finding.question) for finding in found] == [(name, False, True)]


def test_depth_of_the_other_sign_is_found_without_matrices() -> None:
    spoilt = [replace(frame, depth=-frame.depth) for frame in frames()]
    found = [one for one in check_frames(spoilt, has_camera=False, has_jitter=False) if one.name == "depth-negative"]
    assert [(one.mistake, one.fix) for one in found] == [(True, {"depth": {"scale": -1.0}})]
    assert not names(check_frames(frames(), has_camera=False, has_jitter=False))


@pytest.mark.parametrize(("value", "found"), [(0.5, "motion-centred-on-half"), (0.25, "motion-constant")])
def test_vectors_of_a_still_picture_may_lie_around_a_half(value: float, found: str) -> None:
    camera, vectors = make_camera(), np.full((*make_frame().depth.shape, 2), value, np.float32)
    spoilt = [replace(frame, motion=vectors, camera=camera) for frame in frames()]
    assert names(check_channels(spoilt, has_camera=True, has_depth=True)) == [found]


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize(("vector", "asked"), [(-1.5, False), (1.5, True)])
def test_one_vector_in_all_pixels_is_no_question_where_the_pictures_move_by_it(
    vector: float, asked: bool, jitter: float
) -> None:
    """And neither matrices nor depth tell; a jitter moves the pictures too."""

    def drifting(index: int) -> Frame:
        frame = make_frame(index, width=96, height=72, camera=make_camera(), motion=True)
        offset = jitter * (-1) ** index
        x, y = np.arange(96) + offset - 1.5 * index, np.arange(72)[:, None]
        shade = 0.5 + 0.2 * np.sin(0.31 * x + 0.2 * y) * np.sin(0.23 * y) + 0.2 * np.sin(0.11 * x - 0.37 * y)
        motion = np.zeros_like(frame.motion)
        motion[..., 0] = vector
        colour = np.repeat(shade[..., None], 3, -1).astype(np.float32)
        return replace(frame, colour=colour, motion=motion, jitter_px=(offset, 0.0))

    made = [drifting(index) for index in range(4)]
    found = check_frames(made, has_camera=False, has_depth=False, has_jitter=jitter > 0.0)
    assert [finding.question for finding in found if finding.name == "motion-constant"] == [asked]


def test_sound_channels_pass() -> None:
    sound = [replace(f, motion=np.random.default_rng(0).random((f.height, f.width, 2), np.float32)) for f in frames()]
    assert not [*check_channels(sound, has_camera=False, has_depth=True)]


@pytest.mark.parametrize(("brightest", "white"), [(9.0, 0.0), (1.0, 0.99)])
def test_white_and_what_is_brighter_lie_on_no_step(brightest: float, white: float) -> None:
    """A picture that is brighter than white all over, and one that is white but for a hundredth."""
    random = np.random.default_rng(0)
    light = random.uniform(brightest / 6, brightest, make_frame().colour.shape)
    light[random.random(light.shape) < white] = brightest
    found = check_colour([replace(make_frame(), colour=light.astype(np.float32))])
    assert "colour-8-bit" not in names(found, mistakes=False)


def flat(tones: Sequence[float]) -> list[Frame]:
    """A picture of grey ``tones``, of equal areas."""
    light = np.resize(np.array(tones, np.float32), make_frame().depth.shape)
    return [replace(make_frame(), colour=np.repeat(light[..., None], 3, -1))]


@pytest.mark.parametrize("tones", [[0.0, 1.0], [0.0, 0.5, 1.0], [0.2, 0.4, 0.6, 0.8, 1.0], np.arange(18) / 17])
def test_flat_tones_say_nothing_of_a_curve(tones: Sequence[float]) -> None:
    """Masks and flat graphics: of no tone but white, of one in its middle, and even ones that lie on 8-bit steps."""
    assert check_colour(flat(tones)) == []


@pytest.mark.parametrize(("count", "found"), [(19, []), (20, ["colour-encoded"])])
def test_so_many_tones_as_leave_out_the_dark_by_chance_no_oftener_than_confidence_admits(
    count: int, found: list[str]
) -> None:
    """Of tones that lie anywhere below white; with white, and on no 8-bit steps."""
    made = check_colour(flat([*np.linspace(0.2001, 0.9, count), 1.0]))
    assert names(made) == found
    assert ((1.0 - DARKEST_ENCODED) ** count <= 1.0 - SURE_OF_CUT) == bool(found)
    assert {finding.confidence for finding in made} <= {SURE_OF_CUT}


def test_eight_bit_values_are_distinguished_from_linear_light_made_of_them() -> None:
    steps = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.float64) / 255
    linear = np.where(steps <= 0.04045, steps / 12.92, ((steps + 0.055) / 1.055) ** 2.4)
    encoded = [replace(make_frame(0), colour=steps.astype(np.float32))]
    decoded = [replace(make_frame(0), colour=linear.astype(np.float32))]
    assert names(check_colour(encoded)) == ["colour-encoded"]
    assert names(check_colour(decoded)) == []
    assert names(check_colour(decoded), mistakes=False) == ["colour-8-bit"]


@pytest.mark.parametrize(
    ("compression", "found"), [(OpenEXR.DWAA_COMPRESSION, ["file-lossy"]), (OpenEXR.PIZ_COMPRESSION, [])]
)
def test_codecs_that_lose_depth(compression: object, found: list[str], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for index in range(2):
        planes = {name: (rng.random((32, 32)) ** 4 * 3).astype(np.float32) for name in "RGB"}
        planes["Z"] = np.linspace(2, 9, 1024, dtype=np.float32).reshape(32, 32)
        header = {"type": OpenEXR.scanlineimage, "compression": compression}
        OpenEXR.File(header, planes).write(str(tmp_path / f"a.{index:04d}.exr"))
    report, _ = check_folder(tmp_path)
    assert names(report.findings) == found


@pytest.mark.parametrize(
    ("pixels", "compression", "found"),
    [
        (np.float32, OpenEXR.ZIP_COMPRESSION, []),
        (np.float16, OpenEXR.ZIP_COMPRESSION, ["depth-half"]),
        (np.float32, OpenEXR.DWAA_COMPRESSION, ["file-lossy"]),
    ],
)
def test_depth_in_files_of_its_own_is_judged_by_these(
    pixels: type, compression: object, found: list[str], tmp_path: Path
) -> None:
    """The colour beside it is in halves, in a channel of the same name, and packed without loss."""
    rng = np.random.default_rng(0)
    for index in range(2):
        colour = {name: (rng.random((32, 32)) ** 4 * 3).astype(np.float16) for name in "RGB"}
        depth: dict[str, Pixels] = {"R": np.linspace(2, 9, 1024).reshape(32, 32).astype(pixels)}
        for name, planes, codec in (("color", colour, OpenEXR.ZIP_COMPRESSION), ("depth", depth, compression)):
            header = {"type": OpenEXR.scanlineimage, "compression": codec}
            OpenEXR.File(header, planes).write(str(tmp_path / f"{name}.{index:04d}.exr"))
    report, _ = check_folder(tmp_path)
    assert names(report.findings) == found
    assert all("depth" in finding.evidence for finding in report.mistakes)


def test_the_check_does_not_point_to_itself(tmp_path: Path) -> None:
    report, _ = check_folder(write_blender(tmp_path, frames()))
    (note,) = [finding for finding in report.findings if finding.name == "no-jitter"]
    assert note.what == "no jitter: taken as none"
