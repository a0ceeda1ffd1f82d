"""The oracle: a NumPy twin of every stage function, same names, same order of operations, whole arrays at a time.

In float32 the twins give the bits that a strict kernel gives; in float64 they give the value that both approximate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cltaa.reference import gather, gather_window, mix_windows, planes, reprojection, resolve, stages

# Kernel name -> twin; called with (build, layout, **arguments by the kernel's own names).
KERNELS: dict[str, Callable[..., Any]] = {
    "blend": stages.blend_kernel,
    "extend_edges": planes.extend_edges,
    "gather": gather.gather,
    "gather_windows": gather_window.gather_windows,
    "mix_windows": mix_windows.mix_windows,
    "own_motion": reprojection.own_motion_kernel,
    "pack": planes.pack,
    "neighbourhood_statistics": stages.neighbourhood_statistics_kernel,
    "rectify_history": stages.rectify_history_kernel,
    "repair_colour": stages.repair_colour_kernel,
    "resolve": resolve.resolve,
    "sample_history": stages.sample_history_kernel,
    "surface_motion": stages.surface_motion_kernel,
    "unpack": planes.unpack,
}
