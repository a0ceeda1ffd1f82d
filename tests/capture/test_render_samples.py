"""What one sample a pixel is: point samples at the jittered place, linear, unclamped, and hidden where hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa_datasets.scene import AlphaMode, Lamp, Material, Scene, Sky, Sun, Texture
from tests.capture.analytic_scenes import HEIGHT, LENS, WHITE, WIDTH, drawing, instant, place, quad, scene

# llvmpipe moves vertices to multiples of 1/256 pixel (GL_SUBPIXEL_BITS = 8) before it decides what they cover.
SNAP = 1.0 / 256.0


def square(half: float, x: float, y: float, material: Material = WHITE) -> Scene:
    """A square of 2 half x 2 half pixels about (x, y) from the picture's centre, y up, on black."""
    now = instant(place(x, y, 0.0))
    return scene(lambda _: now, (quad(half), material))


def test_an_unjittered_edge_has_only_two_values() -> None:
    turned = np.eye(4)
    turned[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    now = instant(turned)
    with drawing(scene(lambda _: now, (quad(9.3), WHITE))) as renderer:
        colour = renderer.draw(now, now, (0.0, 0.0)).colour[..., :3]
    assert np.unique(colour).tolist() == [0.0, 1.0]
    assert 0.2 < colour.mean() < 0.3  # 18.6^2 of 48 x 32 pixels


@pytest.mark.parametrize("jitter", [-0.45, -0.2, 0.0, 0.19, 0.21, 0.45])
def test_sample_lies_at_the_pixel_centre_plus_jitter(jitter: float) -> None:
    # Right and lower edge at 0.7 of pixel (WIDTH/2 + 8, HEIGHT/2 + 8): covered as long as 0.5 + jitter < 0.7.
    half = 20.0
    what = square(half, 8.7 - half, -(8.7 - half))
    with drawing(what) as renderer:
        now = what.at(0.0)
        row = renderer.draw(now, now, (jitter, 0.0)).colour[HEIGHT // 2, :, 0]
        column = renderer.draw(now, now, (0.0, jitter)).colour[:, WIDTH // 2, 0]
    assert abs(0.5 + jitter - 0.7) > SNAP  # or this test would ask for more than the rasteriser has
    lit = 9 if 0.5 + jitter < 0.7 else 8
    assert row.tolist() == [1.0] * (WIDTH // 2 + lit) + [0.0] * (WIDTH // 2 - lit)
    assert column.tolist() == [1.0] * (HEIGHT // 2 + lit) + [0.0] * (HEIGHT // 2 - lit)


def test_rows_are_turned_over_once() -> None:
    what = square(2.0, 0.0, HEIGHT / 2.0 - 4.0)  # high up in the world
    with drawing(what) as renderer:
        colour = renderer.draw(what.at(0.0), what.at(0.0), (0.0, 0.0)).colour[..., 0]
    assert np.flatnonzero(colour.any(axis=1)).tolist() == [2, 3, 4, 5]


@pytest.mark.parametrize("value", [1.5, 12345.678, 1e30, 1e-30])
def test_values_far_from_one_survive(value: float) -> None:
    what = square(4.0, 0.0, 0.0, replace(WHITE, emissive=(value, 2.0, 0.5)))
    with drawing(what) as renderer:
        colour = renderer.draw(what.at(0.0), what.at(0.0), (0.0, 0.0)).colour
    assert colour[HEIGHT // 2, WIDTH // 2].tolist() == [np.float32(value), 2.0, 0.5, 1.0]


def test_exposure_is_a_factor() -> None:
    what = square(4.0, 0.0, 0.0)
    now = replace(what.at(0.0), exposure=0.25)
    with drawing(what) as renderer:
        assert renderer.draw(now, now, (0.0, 0.0)).colour[HEIGHT // 2, WIDTH // 2, 0] == 0.25


def test_emissive_texture_multiplies_once() -> None:
    texel = Texture(np.full((2, 2, 4), 255, np.uint8))
    what = square(4.0, 0.0, 0.0, replace(WHITE, emissive=(3.0, 0.5, 0.0), emissive_texture=texel))
    with drawing(what) as renderer:
        colour = renderer.draw(what.at(0.0), what.at(0.0), (0.0, 0.0)).colour
    assert colour[HEIGHT // 2, WIDTH // 2].tolist() == [3.0, 0.5, 0.0, 1.0]


def test_matt_surface_reflects_by_lamberts_law() -> None:
    material = Material(base_colour=(0.8, 0.4, 0.2, 1.0), specular=0.0)
    slope = np.radians(35.0)
    sun = Sun((float(np.sin(slope)), 0.0, float(np.cos(slope))), (3.0, 2.0, 1.0))
    now = instant(np.eye(4), lights=(sun,))
    with drawing(scene(lambda _: now, (quad(9.0), material))) as renderer:
        colour = renderer.draw(now, now, (0.0, 0.0)).colour[HEIGHT // 2, WIDTH // 2, :3]
    expected = np.array([0.8, 0.4, 0.2]) / np.pi * [3.0, 2.0, 1.0] * np.cos(slope)
    # Two normalised vectors, their dot product and three factors in float32: below 32 roundings.
    assert np.abs(colour / expected - 1.0).max() <= 32 * 2.0**-24


def test_textures_are_decoded_to_linear() -> None:
    texel = Texture(np.full((1, 1, 4), [188, 64, 10, 255], np.uint8), smooth=False)
    sky = Sky(zenith=(1.0, 1.0, 1.0), horizon=(1.0, 1.0, 1.0), ground=(1.0, 1.0, 1.0))  # evenly lit
    now = instant(np.eye(4), sky=sky)
    with drawing(scene(lambda _: now, (quad(9.0), Material(base_texture=texel, specular=0.0)))) as renderer:
        colour = renderer.draw(now, now, (0.0, 0.0)).colour[HEIGHT // 2, WIDTH // 2, :3]
    encoded = np.array([188, 64, 10]) / 255.0
    linear = np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)
    # OpenGL 4.5 section 8.24 lets the decoding be off by half a step of the 8-bit code.
    step = ((encoded + 0.5 / 255.0 + 0.055) / 1.055) ** 2.4 - ((encoded - 0.5 / 255.0 + 0.055) / 1.055) ** 2.4
    assert np.all(np.abs(colour - linear) <= step / 2.0)


def test_cut_out_shows_what_is_behind() -> None:
    holes = Texture(np.array([[[255, 255, 255, 255], [255, 255, 255, 0]]], np.uint8), smooth=False)
    sieve = replace(WHITE, base_texture=holes, alpha_mode=AlphaMode.MASK)
    now = instant(place(0.0, 0.0, 1.0), np.eye(4))
    behind = replace(WHITE, emissive=(0.25, 0.25, 0.25))
    with drawing(scene(lambda _: now, (quad(10.0), sieve), (quad(10.0), behind))) as renderer:
        drawn = renderer.draw(now, now, (0.0, 0.0))
    row, middle = HEIGHT // 2, WIDTH // 2
    assert drawn.colour[row, middle - 10 : middle + 10, 0].tolist() == [1.0] * 10 + [0.25] * 10
    assert drawn.depth[row, middle - 10 : middle + 10].tolist() == [4.0] * 10 + [5.0] * 10


def test_see_through_surface_leaves_depth_and_motion_and_says_its_share() -> None:
    pane = Material(
        base_colour=(0.0, 0.0, 0.0, 0.25), emissive=(1.0, 0.0, 0.0), specular=0.0, alpha_mode=AlphaMode.BLEND
    )
    now = instant(place(0.0, 0.0, 1.0), np.eye(4))
    before = instant(place(-3.0, 0.0, 1.0), place(2.0, 0.0, 0.0))
    wall = replace(WHITE, emissive=(0.0, 1.0, 0.0))
    what = scene(lambda _: now, (quad(4.0), pane), (quad(10.0), wall), effects="motion reactive")
    with drawing(what) as renderer:
        drawn = renderer.draw(now, before, (0.0, 0.0))
    at = HEIGHT // 2, WIDTH // 2
    assert drawn.colour[at].tolist() == [0.25, 0.75, 0.0, 1.0]
    assert drawn.depth[at] == 5.0
    assert drawn.motion is not None
    assert drawn.motion[at].tolist() == [2.0, 0.0]
    assert drawn.reactive is not None
    assert drawn.reactive[at] == 0.25
    assert drawn.reactive[HEIGHT // 2, WIDTH // 2 + 6] == 0.0


def test_back_faces_are_hidden_unless_the_material_has_two_sides() -> None:
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])  # half a turn about y
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])  # a mirror turns triangles round but not the surface
    for pose, double_sided, seen in ((turned, False, 0.0), (turned, True, 1.0), (mirrored, False, 1.0)):
        now = instant(pose)
        with drawing(scene(lambda _: instant(), (quad(9.0), replace(WHITE, double_sided=double_sided)))) as renderer:
            assert renderer.draw(now, now, (0.0, 0.0)).colour[HEIGHT // 2, WIDTH // 2, 0] == seen


def test_alpha_is_coverage_where_there_is_no_sky() -> None:
    what = square(4.0, 0.0, 0.0)
    with drawing(what) as renderer:
        alpha = renderer.draw(what.at(0.0), what.at(0.0), (0.0, 0.0)).colour[..., 3]
    assert alpha.sum() == 64.0
    assert np.unique(alpha).tolist() == [0.0, 1.0]


def test_sky_is_a_direction_behind_everything() -> None:
    sky = Sky(zenith=(0.0, 0.0, 1.0), horizon=(1.0, 0.0, 0.0), ground=(0.0, 1.0, 0.0))
    now = instant(place(0.0, 0.0, -3.0), lens=LENS, sky=sky)
    with drawing(scene(lambda _: now, (quad(0.2), WHITE), effects="sky")) as renderer:
        drawn = renderer.draw(now, now, (0.0, 0.0))
    assert drawn.colour[-1, 0, :3].tolist() == [0.0, 1.0, 0.0]
    assert drawn.colour[0, 0, 2] > drawn.colour[HEIGHT // 4, 0, 2] > 0.0
    assert np.isposinf(drawn.depth[0]).all()
    assert abs(drawn.depth[HEIGHT // 2, WIDTH // 2] / 3.0 - 1.0) <= 8 * 2.0**-24  # as test_render_geometry derives


def test_light_from_the_eye_is_finite_at_every_pixel() -> None:
    # The half-way vector is the one to the eye, and by rounding their product passes 1 at some of the pixels.
    glossy = Material(base_colour=(0.8, 0.4, 0.2, 1.0), roughness=0.3)
    now = instant(place(0.0, 0.0, -4.0), lens=LENS, lights=(Lamp((0.0, 0.0, 0.0), (9.0, 9.0, 9.0)),), sky=Sky())
    with drawing(scene(lambda _: now, (quad(9.0), glossy)), 256, 256) as renderer:
        colour = renderer.draw(now, now, (0.0, 0.0)).colour
    assert np.isfinite(colour).all()
    assert colour[..., :3].min() > 0.0
