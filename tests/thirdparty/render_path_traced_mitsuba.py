"""Path-trace with Mitsuba 3: ``python render_path_traced_mitsuba.py FOLDER FIRST LAST SIZE SAMPLES``, SIZE: 192x108.

Runs in an environment of its own that has mitsuba. The samples lie anywhere in their pixel. A room that a lamp lights,
under a camera that moves: glass, gloss, leaves cut out by opacity, a body that turns and one that changes its shape, of
which no vectors tell.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from render_mitsuba import FIELD_OF_VIEW  # type: ignore[import-not-found]  # beside this file


def matte(*colour: float) -> dict[str, Any]:
    """A diffuse surface."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}


def checks(one: tuple[float, ...], other: tuple[float, ...], scale: float) -> dict[str, Any]:
    """A checkerboard of two colours."""
    return {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": one},
        "color1": {"type": "rgb", "value": other},
        "to_uv": mi.ScalarTransform4f().scale([scale, scale, 1]),
    }


def film(width: int, height: int) -> dict[str, Any]:
    """An image over the box of each pixel."""
    size = {"width": width, "height": height, "rfilter": {"type": "box"}}
    return {"type": "hdrfilm", **size, "pixel_format": "rgb", "component_format": "float32"}


def scene(frame: int, width: int, height: int, samples: int) -> tuple[Any, Any]:
    """The scene of one frame and its camera's to_world, [4, 4]."""
    time, place = (frame - 1) / 12, mi.ScalarTransform4f().translate
    to_world = mi.ScalarTransform4f().look_at(
        origin=[-0.4 + 0.5 * time, 0.9, 5], target=[0.2 * time, 0.2, 0], up=[0, 1, 0]
    )
    leaves = {
        "type": "mask",
        "opacity": checks((1,) * 3, (0,) * 3, 6),
        "bsdf": {"type": "twosided", "b": matte(0.1, 0.5, 0.1)},
    }
    chrome = {"type": "roughconductor", "alpha": 0.2, "material": "Au"}
    wide = 0.4 * (1.2 - 0.3 * math.cos(3 * time))
    turned = place([0, 0, 0.4]).rotate([0, 1, 0], 40 * time).rotate([1, 0, 0], 57 * time).scale(0.45)
    soft = place([-1.2, -0.55, 1.2]).scale([wide, 0.75 - wide, 0.35])
    lamp = place([1.2, 3, 2]).rotate([1, 0, 0], 75).scale(0.35)
    light = {"type": "area", "radiance": {"type": "rgb", "value": 80.0}}
    content: dict[str, Any] = {
        "type": "scene",
        "integrator": {
            "type": "aov",
            "aovs": "depth:depth,albedo:albedo,normal:sh_normal",
            "image": {"type": "path", "max_depth": 8},
        },
        "sensor": {
            "type": "perspective",
            "fov": FIELD_OF_VIEW,
            "fov_axis": "x",
            "to_world": to_world,
            "near_clip": 0.1,
            "film": film(width, height),
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": (0.06, 0.09, 0.15)}},
        "lamp": {"type": "rectangle", "to_world": lamp, "emitter": light},
        "floor": {
            "type": "cube",
            "to_world": place([0, -1, 0]).scale([7, 0.1, 7]),
            "bsdf": {"type": "diffuse", "reflectance": checks((0.5,) * 3, (0.15,) * 3, 9)},
        },
        "wall": {"type": "cube", "to_world": place([0, 1, -3.5]).scale([7, 3, 0.1]), "bsdf": matte(0.6, 0.35, 0.25)},
        "glass": {"type": "sphere", "center": [1.5, -0.2, 0.6], "radius": 0.7, "bsdf": {"type": "dielectric"}},
        "chrome": {"type": "sphere", "center": [-2.2, -0.1, -0.8], "radius": 0.75, "bsdf": chrome},
        "leaves": {"type": "rectangle", "to_world": place([0.3, 0.4, -1.8]).scale(1.2), "bsdf": leaves},
        "turning": {"type": "cube", "to_world": turned, "bsdf": matte(0.7, 0.1, 0.08)},
        "soft": {"type": "cube", "to_world": soft, "bsdf": matte(0.15, 0.3, 0.7)},
    }
    return mi.load_dict(content), np.array(to_world.matrix, np.float64)


def main(folder: Path, first: int, last: int, size: str, samples: int) -> None:
    """Write the frames and camera.json."""
    mi.set_variant("scalar_rgb")
    folder.mkdir(parents=True, exist_ok=True)
    width, height = map(int, size.split("x"))
    across = 1.0 / np.tan(np.radians(FIELD_OF_VIEW) / 2)
    projection = [[across, 0, 0, 0], [0, across * width / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]
    side = {}
    for frame in range(first, last + 1):
        loaded, to_world = scene(frame, width, height, samples)
        mi.render(loaded, seed=frame + samples)
        loaded.sensors()[0].film().bitmap().write(str(folder / f"shot.{frame:04d}.exr"))
        # Mitsuba's camera has x to the left and looks along +z.
        view = np.diag([-1.0, 1.0, -1.0, 1.0]) @ np.linalg.inv(to_world)
        side[frame] = {"world_to_view": view.tolist(), "view_to_clip": projection, "jitter_px": (0.0, 0.0)}
    (folder / "camera.json").write_text(json.dumps({"frames": side}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], int(sys.argv[5]))
