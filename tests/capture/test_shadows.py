"""Shadows against a square whose shadow can be drawn with a ruler; no map where nothing casts one."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.errors import InternalError
from cltaa_datasets.scene import AlphaMode, Instant, Material, Shadow, Sky, Sun, Texture
from tests.capture.analytic_scenes import HEIGHT, WIDTH, drawing, instant, place, quad, scene

CATCHER = Material(specular=0.0)
MAP = Shadow((0.0, 0.0, 0.0), 40.0, 512)
TEXEL = 2.0 * MAP.radius / MAP.texels  # metres; a pixel of the picture is one metre
DARK = Sky(ambient=0.0)
# The square hangs 2 m before the wall; the sun stands to the right, 45 degrees off the wall's normal: 2 m to the left.
ASIDE = np.sqrt(0.5)
SUN = Sun((float(ASIDE), 0.0, float(ASIDE)), (np.pi, np.pi, np.pi), MAP)


def lit_by(*suns: Sun) -> Instant:
    return instant(place(0.0, 0.0, -2.0), place(0.0, 0.0, 0.0), lights=suns, sky=DARK)


def casting(material: Material = CATCHER) -> np.ndarray:
    what = scene(lambda _: lit_by(SUN), (quad(40.0), CATCHER), (quad(4.0), material))
    with drawing(what) as renderer:
        return np.asarray(renderer.draw(lit_by(SUN), lit_by(SUN), (0.0, 0.0)).colour[..., 0])


def test_a_shadow_falls_where_it_must() -> None:
    picture = casting()
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2.0, HEIGHT / 2.0 - np.arange(HEIGHT) - 0.5)
    covered = (np.abs(x) < 4.0) & (np.abs(y) < 4.0)
    # On the wall the map's texels are 1 / cos 45 wide; the compared point is moved by two, and filtered over one more.
    slack = 4.0 * TEXEL / ASIDE
    across, along = np.abs(x + 2.0) - 4.0, np.abs(y) - 4.0
    inside, outside = (np.maximum(across, along) < -slack) & ~covered, (np.maximum(across, along) > slack) & ~covered
    assert inside.sum() >= 6
    assert outside.sum() > 1000
    assert (picture[inside] == 0.0).all()
    assert np.abs(picture[outside] - ASIDE).max() <= 1e-6
    assert np.abs(picture[covered] - ASIDE).max() <= 1e-6  # what casts the shadow is not in it


def test_what_is_cut_out_casts_no_shadow() -> None:
    texels = np.full((4, 4, 4), 255, np.uint8)
    texels[..., 3] = 0
    holes = Material(base_texture=Texture(texels), specular=0.0, alpha_mode=AlphaMode.MASK)
    assert casting(holes).min() > 0.0


def test_two_suns_that_cast_are_refused() -> None:
    now = lit_by(SUN, SUN)
    with (
        drawing(scene(lambda _: now, (quad(40.0), CATCHER), (quad(4.0), CATCHER))) as renderer,
        pytest.raises(InternalError, match=r"2 suns cast shadows \(expected one at most"),
    ):
        renderer.draw(now, now, (0.0, 0.0))


def test_no_map_is_drawn_where_nothing_casts() -> None:
    now = lit_by(Sun(SUN.direction, SUN.irradiance))
    with drawing(scene(lambda _: now, (quad(40.0), CATCHER), (quad(4.0), CATCHER))) as renderer:
        picture = renderer.draw(now, now, (0.0, 0.0)).colour[..., 0]
        assert renderer._shadow_map is None
    assert np.abs(picture - ASIDE).max() <= 1e-6
