"""The recursive resolve beside gathered samples: what stands has more of them before the ring than in it.

Most of what it is worth is shown by the oracle, whose bits the device has.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.core.parameters import Recursion
from cltaa.core.plan import from_ring_alone, plan_frame, with_effects
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Effect, Frame
from cltaa.opencl.device import Device
from cltaa.opencl.shape import Cut, Shape
from cltaa.reference.launcher import NumpyLauncher
from cltaa.reference.real import Array
from tests.core.standing import plans_of_equal_runs
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 24, 20
TWO = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
MOVING = np.s_[:, : WIDTH // 2]
STANDING = np.s_[:, 2 + WIDTH // 2 :]  # beside what a 3x3 borrows motion from
OWN = frozenset({Effect.MOTION, Effect.DISOCCLUSION})


def drawn(index: int, light: float = 1.0) -> Frame:
    """A texture of two colours a pixel, either of which a sample may find; its left half moves as it says, along
    itself."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=None)
    found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    motion = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    motion[MOVING] = 1.0, 0.0  # whole texels, which history loses no samples by
    colour = (light * np.where(found, TWO[0], TWO[1])).astype(np.float32)
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0), motion=motion, jitter_px=(0.0, 0.0))


def preset_of(name: str, recursion: str) -> Preset:
    return override(load_preset(name), {"current_filter": "none", "recursion": recursion})


def last(preset: Preset, lights: list[float], device: str | None = "numpy") -> Array:
    resolver = Resolver(preset, device, strict=True)
    *_, image = resolver.images(drawn(index, light) for index, light in enumerate(lights))
    return image


def error(image: Array, light: float = 1.0) -> float:
    """Root mean square where the texture stands."""
    return float(np.sqrt(np.mean((image[STANDING] - light * TWO.mean(0)[STANDING]) ** 2)))


@pytest.mark.parametrize("name", ["gather-8", "gather-8+8"])
def test_what_stands_is_a_mean_of_more_than_the_ring_holds(name: str) -> None:
    images = (last(preset_of(name, recursion), [1.0] * 40) for recursion in ("standing", "none"))
    with_it, without = map(error, images)
    assert with_it < 0.75 * without  # 8 or 16 samples against up to 32, in part beside each other


def test_what_moves_along_itself_is_taken_in_place() -> None:
    # As a wheel does: its vectors lead to other colours, of which the recursive resolve has a long history.
    inside = np.s_[:, : WIDTH // 2 - 4]  # windows are weighted by the texels around
    gathered, alone = (
        np.abs(last(preset, [1.0] * 20, device=None)[inside] - TWO.mean(0)[inside]).mean()
        for preset in (
            preset_of("gather-8", "standing"),
            override(load_preset("default"), {"current_filter": "none"}),
        )
    )
    assert gathered < alone / 2


def test_what_moves_with_its_texture_has_a_longer_history_too() -> None:
    def moving(index: int) -> Frame:
        found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
        colour = np.roll(np.where(found, TWO[0], TWO[1]), -index, axis=1).astype(np.float32)
        motion = np.broadcast_to(np.array([1.0, 0.0], np.float32), (HEIGHT, WIDTH, 2))
        return replace(drawn(index), colour=colour, motion=motion)

    left = np.s_[:, :4]  # what has been in view for longest
    errors = []
    for recursion in ("standing", "none"):
        *_, image = Resolver(preset_of("gather-8", recursion), "numpy").images(moving(i) for i in range(20))
        errors.append(float(np.square(image[left] - np.roll(TWO.mean(0), -19, axis=1)[left]).mean()))
    assert errors[0] < 0.75 * errors[1]  # up to 20 samples against 8


@pytest.mark.parametrize(("name", "period"), [("gather-8", 8), ("gather-8", 1000), ("gather-48", 1000)])
def test_what_no_vector_tells_of_is_taken_from_the_frame_of_now(name: str, period: int) -> None:
    # As water does, a soft texture runs over a surface that stands, by a pixel a frame.
    def wave(index: int, jitter: tuple[float, float]) -> Array:
        x = np.arange(WIDTH) + jitter[0] - index
        y = np.arange(HEIGHT)[:, None] + jitter[1]
        return np.repeat((0.5 + 0.3 * np.sin(0.3 * x) * np.cos(0.27 * y))[..., None], 3, axis=2)

    def running(index: int) -> Frame:
        jitter = ((index % period * 0.618) % 1 - 0.5, (index % period * 0.414) % 1 - 0.5)
        return replace(drawn(index), colour=wave(index, jitter).astype(np.float32), motion=None, jitter_px=jitter)

    errors = []
    for preset in (load_preset(name), load_preset(name).replace(recursion="none")):
        *_, image = Resolver(preset, strict=True).images(running(index) for index in range(16))
        errors.append(float(np.abs(image - wave(15, (0.0, 0.0)))[3:-3, 3:-3].mean()))
    assert errors[0] < 0.6 * errors[1]  # which follows the trend of light


def test_a_shot_that_has_just_begun_is_no_refuted_history() -> None:
    # It has few samples because there were few frames. Stripes: what lies beside a pixel agrees, its samples do not.
    def stripes(right: float, down: float) -> Array:
        x, y = np.arange(WIDTH) + right, np.arange(HEIGHT)[:, None] + down
        return np.repeat(np.where((x + 0.3 * y) % 5.1 < 2.55, 0.7, 0.3)[..., None], 3, axis=2)

    def striped(index: int) -> Frame:
        jitter = ((index * 0.618) % 1 - 0.5, (index * 0.414) % 1 - 0.5)
        return replace(drawn(index), colour=stripes(*jitter).astype(np.float32), motion=None, jitter_px=jitter)

    steps = (np.arange(16) + 0.5) / 16 - 0.5
    truth = np.mean([stripes(right, down) for right in steps for down in steps], axis=0)
    errors = []
    for recursion in ("standing", "none"):
        resolver = Resolver(override(load_preset("gather-8"), {"recursion": recursion}), strict=True)
        errors.append([np.abs(image - truth).mean() for image in resolver.images(map(striped, range(7)))])
    assert sum(errors[0]) < 1.02 * sum(errors[1])


def test_a_lamp_that_goes_on_is_followed() -> None:
    lights = [1.0] * 30 + [1.5] * 4
    with_it, without = (
        error(last(preset_of("gather-8", recursion), lights), 1.5) for recursion in ("standing", "none")
    )
    assert with_it < 1.05 * without


@pytest.mark.parametrize("name", ["gather-8", "gather-8+8"])
def test_the_device_has_the_bits_of_the_oracle(name: str) -> None:
    ours, theirs = (last(preset_of(name, "standing"), [1.0] * 14, device) for device in (None, "numpy"))
    assert np.array_equal(bits(ours), bits(theirs))


def test_the_groups_of_a_gpu_gather_the_bits_of_the_oracle(monkeypatch: pytest.MonkeyPatch) -> None:
    # Eight rows a group, as on NVIDIA; of more than 64 work-items PoCL cannot hold the private memory on its stack, and
    # kernels that do not gather are built in a fifth of the time for one.
    shape = Shape(lanes=1, rows=8, group=(1, 1), gather=Cut(1, (8, 8), 0))
    assert HEIGHT % 8  # so that groups reach over the image
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    ours, theirs = (last(preset_of("gather-8", "standing"), [1.0] * 6, device) for device in (None, "numpy"))
    assert np.array_equal(bits(ours), bits(theirs))


@pytest.mark.parametrize("stands", [1, 2, 3])  # from three on the window without motion can be contradicted
def test_a_camera_that_comes_to_stand_has_the_bits_of_the_oracle(stands: int) -> None:
    images = []
    for device in (None, "numpy"):
        resolver = Resolver(preset_of("gather-8", "standing"), device, strict=True)
        for index in range(10 + stands):
            camera = make_camera((0.05 * max(9 - index, 0), 0.0, 5.0))
            images.append(resolver.resolve(replace(drawn(index), camera=camera)))
    ours, theirs = images[9 + stands], images[-1]
    assert np.array_equal(bits(ours), bits(theirs))


# What is found in frames without depth, camera and motion.
FOUND_IN_COLOUR = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.THIN, Effect.ILLUMINATION})


def colour_alone(index: int) -> Frame:
    """As ``drawn``, but nothing tells what moves."""
    return Frame(colour=drawn(index).colour, index=index, found=FOUND_IN_COLOUR)


def planned(effects: frozenset[Effect] | None, *, moves: bool = False) -> Recursion:
    frame = replace(drawn(1), effects=effects)
    before = make_camera((1.0, 0.0, 5.0)) if moves else frame.camera
    return plan_frame(load_preset("gather-8"), frame, before).choices.recursion


def test_only_a_camera_that_stands_has_it() -> None:
    assert planned(None) is planned(OWN) is Recursion.STANDING
    assert planned(None, moves=True) is planned(OWN | {Effect.CAMERA}, moves=True) is Recursion.NONE
    assert planned(frozenset({Effect.DISOCCLUSION})) is Recursion.NONE  # there is one window of all frames


@pytest.mark.parametrize("name", ["gather-8", "gather-8+8"])
def test_frames_without_cameras_have_it_unless_vectors_lead_back_and_ahead(name: str) -> None:
    frame, own = colour_alone(1), drawn(1)
    followed = replace(frame, motion=own.motion), replace(frame, depth=own.depth, camera=own.camera)
    of_each = [plan_frame(load_preset(name), each, None).choices.recursion for each in (frame, *followed)]
    by_vectors = Recursion.STANDING if name == "gather-8" else Recursion.NONE
    assert of_each == [Recursion.STANDING, by_vectors, Recursion.NONE]


def test_vectors_alone_gather_more_samples_than_the_ring_holds() -> None:
    errors = []
    for recursion in ("standing", "none"):
        frames = (replace(colour_alone(index), motion=drawn(index).motion) for index in range(40))
        *_, image = Resolver(preset_of("gather-8", recursion), "numpy").images(frames)
        errors.append(error(image))
    assert errors[0] < 0.5**0.5 * errors[1]  # at least twice the samples


def test_frames_in_which_no_motion_can_be_followed_gather_more_samples_than_the_ring_holds() -> None:
    errors = []
    for recursion in ("standing", "none"):
        *_, image = Resolver(preset_of("gather-8", recursion), "numpy").images(map(colour_alone, range(40)))
        errors.append(error(image))
    assert errors[0] < 0.5**0.5 * errors[1]  # at least twice the samples


def test_noise_adds_samples_where_jitter_repeats() -> None:
    def noisy(index: int) -> Frame:
        return replace(jittered(index, 4), effects=OWN | {Effect.NOISE})

    errors = []
    for recursion in ("standing", "none"):
        *_, image = Resolver(preset_of("gather-8", recursion), "numpy").images(map(noisy, range(40)))
        errors.append(error(image))
    assert errors[0] < 0.5**0.5 * errors[1]  # at least twice the samples


def test_a_sequence_is_split_only_where_frames_are_of_the_ring_alone() -> None:
    ring, own, moving = load_preset("gather-8"), drawn(0), OWN | {Effect.CAMERA}
    assert not from_ring_alone(ring, replace(own, effects=OWN))
    assert from_ring_alone(ring, replace(own, effects=moving))
    assert from_ring_alone(preset_of("gather-8", "none"), replace(own, effects=OWN))
    assert from_ring_alone(load_preset("gather-48").replace(recursion="none"), own)
    assert not from_ring_alone(ring, colour_alone(0))
    assert not from_ring_alone(ring, replace(colour_alone(0), motion=own.motion))
    assert from_ring_alone(load_preset("gather-8+8"), replace(colour_alone(0), motion=own.motion))
    unread = with_effects(replace(colour_alone(0), motion=own.motion), FOUND_IN_COLOUR)
    assert not from_ring_alone(load_preset("gather-8+8"), unread)  # no vectors, since no motion is said to occur
    with pytest.raises(UsageError, match="resolves this frame from the result before it"):
        Resolver("gather-8", "numpy").keep(drawn(0))


def test_drift_has_to_be_surer_and_refutes_nothing_where_no_light_is_known_to_change() -> None:
    def planned(effects: frozenset[Effect] | None) -> tuple[float, float]:
        settings = plan_frame(load_preset("gather-48"), replace(drawn(1), effects=effects), None).settings
        return settings.drift_t, settings.refuted_samples

    own = load_preset("gather-48").settings
    for effects in (None, OWN | {Effect.ILLUMINATION}, OWN | {Effect.REACTIVE}):
        assert planned(effects) == (own.drift_t, own.refuted_samples)
    assert planned(OWN) == (2.0 * own.drift_t, 0.0)


def test_a_history_that_lacks_frames_that_were_only_kept_is_not_read() -> None:
    """They declare other effects than the one after them, whose mean would hold what was resolved before them."""
    preset = load_preset("gather-48").replace(recursion="none")
    resolver = Resolver(preset, "numpy")
    for index in range(4):
        resolver.resolve(replace(drawn(index), effects=OWN))
    for index in range(4, 8):
        resolver.keep(replace(drawn(index), effects=OWN))
    after = replace(drawn(8), effects=frozenset())
    image = resolver.resolve(after)
    assert np.array_equal(bits(image), bits(Resolver(preset, "numpy").resolve(after)))


def jittered(index: int, period: int) -> Frame:
    return replace(drawn(index), jitter_px=(0.01 * (index % period), 0.0))


def test_a_checkpoint_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    plans_of_equal_runs("gather-8", [jittered(index, 4) for index in range(12)], tmp_path)


class Interrupted(NumpyLauncher):
    """Is interrupted where it is waited for, after so many ``waits`` more."""

    waits = -1

    def finish(self) -> None:
        self.waits -= 1
        if self.waits == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("waits", [1, 2, 3], ids=["uploaded", "resolved", "read back"])
def test_a_frame_that_is_given_again_has_its_bits(waits: int) -> None:
    launcher = Interrupted()
    whole, resolver = Resolver("gather-8", "numpy"), Resolver("gather-8", launcher)
    for index in range(11):
        expected = whole.resolve(jittered(index, 8))
    for index in range(10):
        resolver.resolve(jittered(index, 8))
    launcher.waits = waits
    with pytest.raises(KeyboardInterrupt):
        resolver.resolve(jittered(10, 8))
    assert np.array_equal(bits(resolver.resolve(jittered(10, 8))), bits(expected))


def test_without_a_ring_there_is_nothing_beside_it() -> None:
    alone = override(load_preset("gather-8"), {"history": "accumulated"})
    effects = frozenset({Effect.DISOCCLUSION})
    for_both = [Resolver(override(alone, {"recursion": recursion}), "numpy") for recursion in ("standing", "none")]
    for index in range(6):
        one, other = (resolver.resolve(replace(drawn(index), effects=effects)) for resolver in for_both)
    assert np.array_equal(bits(one), bits(other))
