"""What the last frame of a resolver read and left."""

from __future__ import annotations

from typing import Any

from cltaa.core.resolver import Resolver


def last_planes(resolver: Resolver, argument: str) -> Any:
    """The planes [n, H, W] of an argument of the last frame's kernel, such as ``output_count``."""
    assert resolver.last is not None
    with resolver.last.arguments[argument].mapped(write=False) as planes:
        return resolver.last.layout.inside(planes).copy()
