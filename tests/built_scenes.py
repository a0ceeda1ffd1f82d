"""Scenes that several folders of tests look at, each built once in a run: some paint textures for two seconds."""

from __future__ import annotations

from functools import cache

from cltaa_datasets.scene import Scene
from cltaa_datasets.scenes import build_scene


@cache
def built(name: str) -> Scene:
    """The scene of that name with seed 0; nobody may write into its arrays."""
    return build_scene(name)
