"""Render a small sequence with Mitsuba 3 (``python render_mitsuba.py FOLDER FRAMES WIDTH HEIGHT``), with its cameras.

Runs in an environment of its own that has mitsuba. Each pixel is one sample at its centre, jittered by the principal
point; surfaces only emit, so that one sample has no noise. The AOV depth is along the ray.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

FIELD_OF_VIEW, PERIOD = 50.0, 8
ORDERS = (0, 4, 2, 6, 1, 5, 3, 7), (0, 3, 6, 1, 4, 7, 2, 5)


def jitter(frame: int) -> tuple[float, float]:
    """A centred pattern of PERIOD, in pixels, x right, y down."""
    x, y = ((order[frame % PERIOD] + 0.5) / PERIOD - 0.5 for order in ORDERS)
    return x, y


def box(transform: Any, dark: tuple[float, ...], light: tuple[float, ...], scale: float) -> dict[str, Any]:
    """A cube whose surface glows in checks."""
    checks = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": dark},
        "color1": {"type": "rgb", "value": light},
        "to_uv": mi.ScalarTransform4f().scale([scale, scale, 1]),
    }
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return {"type": "cube", "to_world": transform, "bsdf": black, "emitter": {"type": "area", "radiance": checks}}


def scene(frame: int, width: int, height: int) -> tuple[Any, Any]:
    """The scene of one frame and its camera's to_world, [4, 4]."""
    along, (jx, jy) = frame / 12.0, jitter(frame)
    to_world = mi.ScalarTransform4f().look_at(
        origin=[0.9 * along, 1.6 + 0.3 * along, 6.0], target=[0.2 * along, 0.6, 0.0], up=[0, 1, 0]
    )
    move = mi.ScalarTransform4f().translate
    content: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "aov", "aovs": "depth:depth", "image": {"type": "direct"}},
        "sensor": {
            "type": "perspective",
            "fov": FIELD_OF_VIEW,
            "fov_axis": "x",
            "to_world": to_world,
            "near_clip": 0.1,
            "principal_point_offset_x": jx / width,
            "principal_point_offset_y": jy / height,
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "stratified", "sample_count": 1, "jitter": False},
        },
        "floor": box(move([0, -1, 0]).scale([12, 0.1, 12]), (0.05, 0.04, 0.03), (0.6, 0.5, 0.4), 12),
        "wall": box(move([0, 2, -6]).scale([12, 4, 0.1]), (0.1, 0.1, 0.3), (0.7, 0.6, 0.2), 8),
    }
    rng = np.random.default_rng(3)
    for place in range(6):
        at = rng.uniform((-3, -0.5, -3), (3, 1.5, 2)).tolist()
        turned = move(at).rotate(rng.uniform(-1, 1, 3).tolist(), float(rng.uniform(0, 90))).scale(0.5)
        content[f"box{place}"] = box(turned, (0.03, 0.05, 0.02 * place), (0.9, 0.2 * place, 0.4), 4)
    return mi.load_dict(content), np.array(to_world.matrix, np.float64)


def main(folder: Path, frames: int, width: int, height: int) -> None:
    """Write the frames and camera.json."""
    mi.set_variant("scalar_rgb")
    folder.mkdir(parents=True, exist_ok=True)
    across = 1.0 / np.tan(np.radians(FIELD_OF_VIEW) / 2)
    projection = [[across, 0, 0, 0], [0, across * width / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]
    side = {}
    for frame in range(1, frames + 1):
        loaded, to_world = scene(frame, width, height)
        mi.render(loaded)
        loaded.sensors()[0].film().bitmap().write(str(folder / f"shot.{frame:04d}.exr"))
        # Mitsuba's camera has x to the left and looks along +z.
        view = np.diag([-1.0, 1.0, -1.0, 1.0]) @ np.linalg.inv(to_world)
        side[frame] = {"world_to_view": view.tolist(), "view_to_clip": projection, "jitter_px": jitter(frame)}
    (folder / "camera.json").write_text(json.dumps({"frames": side}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:5]))
