"""A loop in torch whose frames are anti-aliased: python examples/torch_loop.py

Tensors in the host's memory go in as they are (by DLPack), in torch's order too ([C, H, W] seen as [H, W, C]), and the
result is written into a tensor: nothing is copied. A tensor on a GPU comes to the host first: ``tensor.cpu()``.
"""

import sys

import numpy as np
import torch

import cltaa

width, height, frames = (int(text) for text in sys.argv[1:] or ("320", "180", "24"))
rows, columns = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
samples = np.random.default_rng(0)
result = torch.empty(height, width, 3)
speed = 0.75  # pixels a frame, to the right


def draw(index: int, x: float, y: float) -> torch.Tensor:
    """Stripes that move to the right, [3, H, W], sampled at (x, y) from the centre of each pixel."""
    phase = (columns + x - speed * index) * 0.9 + (rows + y) * 0.35
    stripes = (torch.sin(phase) > 0).float()
    return torch.stack([stripes, 0.5 * stripes, 1 - stripes])


motion = torch.tensor([-speed, 0.0]).expand(height, width, 2)  # to where it was in the frame before
with cltaa.Resolver() as resolver:
    for index in range(frames):
        x, y = samples.uniform(-0.5, 0.5, 2)
        colour = draw(index, x, y).movedim(0, -1)
        resolver.resolve(cltaa.Frame(index, colour, jitter_px=(x, y), motion=motion), out=result.numpy())
        loss = (result - colour).square().mean()  # the result is a tensor like any other
print(f"{frames} frames, the last one {loss.item():.4f} from what was drawn")
