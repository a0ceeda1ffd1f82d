"""What a folder of another tool's files does not have, and what is done without it, for a reader."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cltaa.inputs.roles import assign, unnumbered
from cltaa.inputs.views import Views

if TYPE_CHECKING:
    from cltaa.inputs.intake import Intake

# What tools call vectors and depth, in the name of a channel or of its file.
MOTION_NAME = re.compile(r"mot(ion|vec)|veloc|vector|flow|(^|[._])mvs?($|[._])", re.IGNORECASE)
DEPTH_NAME = re.compile(r"depth|(^|[._])dist(ance)?($|[._])|(linear|view|eye|scene)_?z($|[._])", re.IGNORECASE)
# What a resolve of frames that nothing shines through takes for nothing (docs/decisions/0053-alpha-that-is-1.md).
OPAQUE = "alpha is 1 everywhere: --input colour.alpha=none gives the same colours, a tenth to a fifth faster"


def notes_of(intake: Intake, folder: Path) -> list[str]:
    """One line for each thing that is not there: what is done without it, and how to give it."""
    notes = []
    if not intake.has_camera:
        kept = (
            "motion vectors alone tell what moves" if "motion" in intake.roles else "the camera is taken to stand still"
        )
        notes.append(f"no matrices: {kept}; give them with --camera FILE")
    if "depth" not in intake.roles:
        rest = "nothing is told apart by distance, and moving edges are less exact"
        notes.append(f"no depth: {rest}{_may_be('depth', DEPTH_NAME, intake.unused)}")
    if "motion" not in intake.roles:
        rest = (
            "the camera's motion comes from depth and matrices" if intake.has_camera and "depth" in intake.roles else ""
        )
        like = _may_be("motion", MOTION_NAME, intake.unused)
        notes.append(f"no motion vectors: {rest or 'whatever moves is rectified only'}{like}")
    elif intake.step > 1:
        notes.append(
            f"frames {intake.step} apart: vectors are taken to lead as far back; where they lead one back, "
            "--input motion.channels='none none' leaves them out"
        )
    if not intake.has_jitter:
        notes.append("no jitter: taken as none; if the pixels are jittered, cltaa check shows by how much")
    return notes + _left_out(intake, folder)


def _left_out(intake: Intake, folder: Path) -> list[str]:
    """One line for each thing that is there and is not read."""
    views, notes = intake.views, list[str]()
    if len(views.names) > 1:
        taken = views.of(place.channel for place in intake.roles["colour"])
        other = next(view for view in views.names if view != taken)
        notes.append(
            f"several views: {taken} of {', '.join(views.names)} is taken; to take {other}: --input colour.view={other}"
        )
    if others := _like_the_colour(intake, views):
        taken = shlex.quote(" ".join(f"{others[0]}.{name.channel.split('.')[-1]}" for name in intake.roles["colour"]))
        notes.append(
            f"another layer: {', '.join(others)} not resolved; to take {others[0]}: --input colour.channels={taken}"
        )
    if late := _late(intake):
        notes.append(
            f"not in the first frame: {', '.join(late)}; left out of all, for a channel is read of every frame"
        )
    if left := unnumbered(folder):
        notes.append(f"no number: {', '.join(left)}; left out, for the name of a frame ends with its number")
    return notes


def _late(intake: Intake) -> list[str]:
    """Channels that could play a role that nothing plays, and that only later frames have, in the colour's files."""
    files = intake.roles["colour"][0].files
    every = {name for layout in intake.layouts.values() for name in layout.channels}
    could = assign(intake.profile, {files: sorted(every)})
    places = [place for role, its in could.items() if role not in intake.roles for place in its]
    return [place.channel for place in places if place.channel not in intake.first[files].channels]


def _like_the_colour(intake: Intake, views: Views) -> list[str]:
    """Other layers that are called as that of the colour is, such as the beauty of another view layer.

    Those of the colour's view, if there are ``views``.
    """
    colour = intake.roles["colour"][0].channel
    tail, view = views.without(colour).split(".")[-2:], views.of([colour])
    return [
        name.rpartition(".")[0]
        for name in intake.unused
        if len(tail) > 1 and views.without(name).split(".")[-2:] == tail and views.of([name]) == view
    ]


def _may_be(role: str, pattern: re.Pattern[str], names: Sequence[str]) -> str:
    """How to take as depth or motion what its name says it is; what its numbers mean is left to ``cltaa check``."""
    count = 2 if role == "motion" else 1
    like = [name for name in names if pattern.search(name)]
    if len(like) < count:
        return ""
    letters = "ruxgvy"  # red or u or x is across; a third and a fourth are something else
    across_first = sorted(like, key=lambda name: (len(name), f"{letters}{name[-1]}".lower().index(name[-1].lower())))
    taken = " ".join(across_first[:count])
    option = f"--input {role}.channels={shlex.quote(taken)}"
    return f"; to take {'those' if count > 1 else 'that'} in {taken}: {option}, which cltaa check judges"
