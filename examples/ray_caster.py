"""A ray caster in NumPy whose frames are anti-aliased as they are drawn: python examples/ray_caster.py

One sample a pixel, a sphere over a chequered floor, a camera that slides. Prints how far a frame as it was drawn, and
as it was resolved, are from the truth, which is the mean of 64 samples a pixel.
"""

import sys

import numpy as np
from numpy.typing import NDArray

import cltaa

Image = NDArray[np.float32]
width, height, frames = (int(text) for text in sys.argv[1:] or ("320", "180", "24"))
focal = 1 / np.tan(np.radians(60) / 2)
projection = np.array([[focal * height / width, 0, 0, 0], [0, focal, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]])
jitters = np.random.default_rng(0).permutation(np.mgrid[:4, :4].reshape(2, 16).T / 4 - 0.375)  # centred on the pixel


def eye(index: int) -> NDArray[np.float64]:
    """Where the camera stands; it looks along -z."""
    return np.array([0.01 * index, 0.6, 4.0])


def cast(index: int, jitter_px: NDArray[np.float64]) -> tuple[Image, Image]:
    """Colour [H, W, 3] and depth [H, W] along the view axis, of one ray a pixel through the jittered place."""
    rows, columns = np.mgrid[:height, :width]
    x = ((columns + 0.5 + jitter_px[0]) * 2 / width - 1) * width / height / focal
    y = (1 - (rows + 0.5 + jitter_px[1]) * 2 / height) / focal  # row 0 is at the top
    ray, start = np.stack([x, y, np.full_like(x, -1)], -1), eye(index)  # z of the ray is -1: distance is depth
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(y < 0, -start[1] / y, np.inf)
        a, b, c = (ray * ray).sum(-1), 2 * ray @ (start - (0, 0.5, 0)), ((start - (0, 0.5, 0)) ** 2).sum() - 0.25
        sphere = np.where(b * b > 4 * a * c, (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a), np.inf)
    depth = np.minimum(floor, sphere)
    place = start + ray * np.where(np.isinf(depth), 0, depth)[..., None]
    chequer = 0.1 + 0.7 * ((np.floor(4 * place[..., 0]) + np.floor(4 * place[..., 2])) % 2)
    light = np.clip(2 * (place - (0, 0.5, 0)) @ (0.48, 0.6, 0.64), 0.05, 1)  # the sphere has radius 1/2
    grey = np.where(np.isinf(depth), 0.5, np.where(sphere < floor, light, chequer))
    return np.repeat(grey[..., None], 3, -1).astype(np.float32), depth.astype(np.float32)


with cltaa.Resolver() as resolver:
    for index in range(frames):
        jitter = jitters[index % len(jitters)]
        view = np.eye(4)
        view[:3, 3] = -eye(index)
        colour, depth = cast(index, jitter)
        camera = cltaa.Camera(world_to_view=view, view_to_clip=projection)
        image = resolver.resolve(cltaa.Frame(index, colour, depth, camera, (jitter[0], jitter[1])))
truth = np.stack([cast(index, np.array([x, y]) / 8 - 0.4375)[0] for x in range(8) for y in range(8)]).mean(0)
for name, shown in (("drawn", colour), ("resolved", image)):
    print(f"{name}: {cltaa.measure(shown, truth, 'psnr')['psnr']:.1f} dB")
