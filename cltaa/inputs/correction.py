"""A correction that the detector found, on top of the profile by which it had read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from cltaa.inputs.profile import Cameras, Profile, convert_profile

# Keys of a camera that a second correction turns back.
TURNED = ("layout", "view_layout", "projection_layout", "sense")


def correct(profile: Profile, fix: Mapping[str, Mapping[str, Any]]) -> Profile:
    """``profile`` with a correction that the detector found on top: factors multiply, flags turn over, the rest is set.

    A correction speaks of the converted numbers, a profile of the stored ones.
    """
    values = msgspec.to_builtins(profile)
    for section, keys in fix.items():
        if "sense" in keys:  # of F V M, F and M flips, the inverse is M inv(V) F
            held = values[section]
            held["flip_z"], held["mirrored"] = held["mirrored"], held["flip_z"]
        for name, change in keys.items():
            before = values[section][name]
            if name == "scale" and isinstance(before, list | tuple):
                # Exchanged axes exchange the factors that were there before.
                first = list(before)[::-1] if keys.get("swap") else list(before)
                values[section][name] = [a * b for a, b in zip(first, change, strict=True)]
            elif name == "scale":
                values[section][name] = before * change
            elif name in ("offset", "delay") and section == "jitter":
                values[section][name] = (
                    before + change if name == "delay" else [a + b for a, b in zip(before, change, strict=True)]
                )
            elif isinstance(change, bool):
                values[section][name] = before != change
            elif before == change and name in TURNED:
                values[section][name] = getattr(Cameras(), name)
            else:
                values[section][name] = change
    return convert_profile(values, "correction")
