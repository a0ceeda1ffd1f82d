"""Procedural textures, tileable, from a seeded generator; arguments are linear colours, texels are sRGB-encoded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cltaa.io.display import encoded
from cltaa_datasets.scene import Colour, Texture

Floats = NDArray[np.float64]
Generator = np.random.Generator

SIZE = 512  # texels per side


def make_texture(colour: Floats, alpha: Floats | None = None, *, smooth: bool = True) -> Texture:
    """Make a texture of linear ``colour`` [H, W, 3] and ``alpha`` [H, W], row 0 at the top."""
    opaque = np.ones(colour.shape[:2]) if alpha is None else np.clip(alpha, 0.0, 1.0)
    texels = np.dstack([encoded(np.clip(colour, 0.0, 1.0)), opaque])
    return Texture(np.rint(texels * 255.0).astype(np.uint8), smooth=smooth)


def paint(mask: Floats, off: Colour | Floats, on: Colour | Floats) -> Floats:
    """Mix two colours by ``mask`` [H, W] in [0, 1] into [H, W, 3]."""
    low, high = np.asarray(off, np.float64), np.asarray(on, np.float64)
    return low + mask[..., None] * (high - low)


def enlarged(grid: Floats, height: int, width: int) -> Floats:
    """Sample a periodic cubic spline through ``grid`` at ``height`` x ``width`` positions.

    Equals ``ndimage.zoom(..., mode="grid-wrap", grid_mode=True)`` up to rounding, but works along one axis after the
    other, with two times four taps in place of sixteen.
    """
    values: Floats = ndimage.spline_filter(grid, order=3, mode="grid-wrap")
    for axis, size in enumerate((height, width)):
        count = values.shape[axis]
        place = (np.arange(size) + 0.5) * (count / size) - 0.5
        first = np.floor(place).astype(np.intp) - 1
        x = (place - np.floor(place)).reshape([-1 if a == axis else 1 for a in (0, 1)])
        y = 1.0 - x
        inner = [(part * part * (part - 2.0) * 3.0 + 4.0) / 6.0 for part in (x, y)]
        weights = (y**3 / 6.0, *inner, x**3 / 6.0)
        taps = (weight * np.take(values, (first + n) % count, axis) for n, weight in enumerate(weights))
        values = sum(taps, start=np.zeros(()))
    return values


def noise(rng: Generator, cells: int, octaves: int = 5) -> Floats:
    """Make tileable fractal value noise in [0, 1]: each octave doubles the cells and halves the amplitude."""
    total, share = np.zeros((SIZE, SIZE)), 1.0
    for octave in range(octaves):
        count = min(cells << octave, SIZE)
        grid = rng.random((count, count))
        total += share * enlarged(grid, SIZE, SIZE)
        share *= 0.5
    return np.asarray((total - total.min()) / (total.max() - total.min()))


def coordinates(size: int = SIZE) -> tuple[Floats, Floats]:
    """Return texel centres (across, down) in [0, 1), each [size, size]."""
    centre = (np.arange(size) + 0.5) / size
    across, down = np.meshgrid(centre, centre)
    return across, down


def checker(light: Colour, dark: Colour, cells: int = 8, rng: Generator | None = None) -> Texture:
    """Make a checkerboard with hard edges; a generator varies the shade of each field a little."""
    across, down = coordinates()
    field = (np.floor(across * cells) + np.floor(down * cells)) % 2.0
    colour = paint(field, dark, light)
    if rng is not None:
        shade = np.kron(rng.uniform(0.75, 1.0, (cells, cells)), np.ones((SIZE // cells, SIZE // cells)))
        colour = colour * (shade * (0.88 + 0.12 * noise(rng, 8)))[..., None]
    return make_texture(colour, smooth=rng is not None)


def blocks(
    rng: Generator, colour: Colour, mortar: Colour, columns: int, rows: int, gap: float, *, bonded: bool = True
) -> Texture:
    """Make bricks (``bonded``: every second row shifted by half) or tiles, each with its own shade, in mortar."""
    across, down = coordinates()
    row = np.floor(down * rows)
    shifted = (across * columns + (0.5 * (row % 2.0) if bonded else 0.0)) % columns
    column = np.floor(shifted)
    inside_x, inside_y = shifted - column, down * rows - row
    edge_x = np.minimum(inside_x, 1.0 - inside_x) / columns
    edge_y = np.minimum(inside_y, 1.0 - inside_y) / rows
    body = np.clip((np.minimum(edge_x, edge_y) - gap / 2.0) * SIZE / 2.0, 0.0, 1.0)
    shade = rng.uniform(0.55, 1.0, (rows, columns))[row.astype(int), column.astype(int)]
    warmth = rng.uniform(-0.12, 0.12, (rows, columns))[row.astype(int), column.astype(int)]
    tint = np.stack([1.0 + warmth, np.ones_like(warmth), 1.0 - warmth], -1)
    grain = 0.7 + 0.3 * noise(rng, 16)
    face = np.asarray(colour) * tint * (shade * grain)[..., None]
    return make_texture(paint(body, np.asarray(mortar) * grain[..., None], face))


def planks(rng: Generator, colour: Colour) -> Texture:
    """Make six wooden boards along u with grain and dark joints."""
    (_, down), boards = coordinates(), 6
    board = np.floor(down * boards).astype(int)
    across_grain = enlarged(rng.random((SIZE // 2, 8)), SIZE, SIZE)
    shade = rng.uniform(0.6, 1.0, boards)[board] * (0.65 + 0.5 * across_grain) * (0.85 + 0.15 * noise(rng, 4))
    inside = down * boards - board
    joint = np.clip((np.minimum(inside, 1.0 - inside) / boards) * SIZE / 2.0, 0.25, 1.0)
    return make_texture(np.asarray(colour) * (shade * joint)[..., None])


def mottle(rng: Generator, low: Colour, high: Colour, cells: int = 8) -> Texture:
    """Mix two colours by fractal noise: ground, plaster, stone."""
    return make_texture(paint(noise(rng, cells, 6), low, high))


def stripes(first: Colour, second: Colour, count: int = 8, slant: int = 0) -> Texture:
    """Make hard stripes across u; ``slant`` whole repeats of shear along v."""
    across, down = coordinates()
    return make_texture(paint(np.floor((across * count + down * slant) % 1.0 * 2.0), first, second))


def lettering(rng: Generator, ink: Colour, paper: Colour, lines: int = 24) -> Texture:
    """Make a page of random letters: rows of words of five-by-seven dot glyphs, legible only close up."""
    cell_w, cell_h = 6, 9
    columns = lines * cell_h // cell_w
    page = np.zeros((lines * cell_h, columns * cell_w))
    alphabet = rng.random((26, 7, 5)) < 0.5
    alphabet[:, :, 0] |= rng.random((26, 7)) < 0.6
    for line in range(lines):
        letters = rng.integers(0, 26, columns)
        spaces = rng.random(columns) < 0.18
        for column in np.flatnonzero(~spaces):
            top, left = line * cell_h + 1, column * cell_w
            page[top : top + 7, left : left + 5] = alphabet[letters[column]]
    across, down = coordinates()
    rows, columns_ = (down * page.shape[0]).astype(int), (across * page.shape[1]).astype(int)
    margin = (np.abs(across - 0.5) < 0.45) & (np.abs(down - 0.5) < 0.45)
    return make_texture(paint(page[rows, columns_] * margin, paper, ink))


def lattice(colour: Colour, cells: int = 8, bar: float = 0.3) -> Texture:
    """Make a diagonal lattice, cut out (alpha 0) between the bars."""
    across, down = coordinates()
    first = np.abs(((across + down) * cells) % 1.0 - 0.5)
    second = np.abs(((across - down) * cells) % 1.0 - 0.5)
    # A ramp of a few texels keeps the edge of the cut-out smooth after filtering alpha.
    alpha = np.clip((bar / 2.0 - np.minimum(first, second)) * SIZE / (4.0 * cells) + 0.5, 0.0, 1.0)
    shade = 0.7 + 0.3 * (first < second)
    return make_texture(np.asarray(colour) * shade[..., None], alpha)


def leaves(rng: Generator, low: Colour, high: Colour, count: int = 320) -> Texture:
    """Make foliage: overlapping leaf shapes of different shades on a cut-out ground (alpha 0)."""
    colour, alpha = np.ones((SIZE, SIZE, 3)) * np.asarray(low), np.zeros((SIZE, SIZE))
    reach = np.arange(-40, 41)  # texels around a leaf's centre; the longest leaf is 36 long
    for _ in range(count):
        x, y, turn, shade = rng.random(4)
        length = rng.uniform(0.03, 0.07)
        patch = np.ix_((int(y * SIZE) + reach) % SIZE, (int(x * SIZE) + reach) % SIZE)
        dx, dy = reach / SIZE, reach[:, None] / SIZE
        along = (dx * np.cos(2 * np.pi * turn) + dy * np.sin(2 * np.pi * turn)) / length
        aside = (dy * np.cos(2 * np.pi * turn) - dx * np.sin(2 * np.pi * turn)) / (0.4 * length)
        cover = np.clip((1.0 - along**2 - np.abs(aside)) * length * SIZE / 4.0 + 0.5, 0.0, 1.0)
        rib = 0.75 + 0.25 * np.clip(np.abs(aside) * 6.0, 0.0, 1.0)
        leaf = (np.asarray(low) + shade * (np.asarray(high) - np.asarray(low))) * rib[..., None]
        colour[patch] = np.where((cover > 0.5)[..., None], leaf, colour[patch])
        alpha[patch] = np.maximum(alpha[patch], cover)
    return make_texture(colour, alpha)


def zone_plate() -> Texture:
    """Make rings cos(pi r^2 / SIZE); their frequency grows from 0 to half a cycle per texel at the edge."""
    across, down = coordinates()
    squared = ((across - 0.5) ** 2 + (down - 0.5) ** 2) * SIZE**2
    return make_texture(paint(0.5 + 0.5 * np.cos(np.pi * squared / SIZE), (0.02, 0.02, 0.02), (0.9, 0.9, 0.9)))
