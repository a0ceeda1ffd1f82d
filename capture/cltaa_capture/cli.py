"""``cltaa capture``: draw a scene into an EXR sequence."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cltaa.commands.options import COUNT_OR_0, FILE_PATH, FROM_2, SIZE, json_option
from cltaa.printable import counted, json_of, printable
from cltaa.progress import shown_progress
from cltaa_capture.jitter import USUAL
from cltaa_capture.osmesa import BACKENDS
from cltaa_datasets import MOTIONS

if TYPE_CHECKING:
    from cltaa_capture.sequence import Captured, Request


def complete_scene(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the scenes whose names begin with ``incomplete``."""
    from cltaa_datasets.scenes import registered

    return [entry.name for entry in registered() if entry.name.startswith(incomplete)]


@click.command(short_help="Draw a scene into a jittered EXR sequence.")
@click.argument("scene", shell_complete=complete_scene)
@click.option("-o", "--output", type=FILE_PATH, required=True, help="Folder for the sequence; created if missing.")
@click.option("--frames", type=click.IntRange(1), default=48, help="Number of frames.")
@click.option("--size", type=SIZE, default="640x360", help="Size of a frame in pixels.")
@click.option(
    "--jitter",
    default=USUAL,
    help="Sample positions: none; halton:N, r2:N, lattice:N, grid:N or hammersley:N, centred, with period N; or vireo, "
    "babylon or simvx as published.",
)
@click.option(
    "--reference", type=COUNT_OR_0, default=0, help="Also draw the truth, N samples a pixel, into reference/."
)
@click.option(
    "--yardstick",
    type=FROM_2,
    default="",
    show_default=False,
    help="For each N of a comma-separated list, also draw the frames with N samples a pixel into reference-N/ and "
    "record the time, for cltaa bench accuracy.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of textures, placement and phase.")
@click.option("--fps", type=click.FloatRange(0.0, min_open=True), default=30.0, help="Frames per second.")
@click.option(
    "--motion",
    type=click.Choice(MOTIONS),
    help="Motion of file:PATH.  [default: play if it is animated, else turntable]",
)
@click.option("--backend", type=click.Choice(BACKENDS), default="auto", help="Off-screen OpenGL implementation.")
@click.option("--restart", is_flag=True, help="Replace the capture in a folder that was begun with other settings.")
@json_option
def capture(scene: str, output: Path, size: tuple[int, int], as_json: bool, **options: Any) -> None:
    """Draw SCENE (a name of cltaa scenes, or file:PATH) into a jittered EXR sequence.

    Every frame holds one sample a pixel: linear HDR colour, planar depth, un-jittered matrices, the jitter, and those
    channels that the scene's effects need. The same command continues an interrupted capture.
    """
    from cltaa_capture.sequence import Request, capture_sequence  # imported late: loads trimesh, which help must not

    request = Request(scene=scene, output=output, width=size[0], height=size[1], **options)
    begin = time.perf_counter()
    with shown_progress(scene.rpartition("/")[2]) as progress:
        captured = capture_sequence(request, progress)
    _print_summary(request, captured, time.perf_counter() - begin, as_json)


def _print_summary(request: Request, captured: Captured, seconds: float, as_json: bool) -> None:
    if as_json:
        summary = {
            "folder": str(request.output),
            "scene": captured.scene.name,
            "effects": sorted(captured.scene.effects),
            "frames": request.frames,
            "drawn": captured.drawn,
            "kept": captured.kept,
            "supersampled": captured.supersampled,
            "width": request.width,
            "height": request.height,
            "reference": request.reference,
            "backend": captured.backend,
            "opengl": captured.opengl,
            "seconds": round(seconds, 3),
        }
        click.echo(json_of(summary))
        return
    kept = f", {captured.kept} kept" if captured.kept else ""
    truth = f", {counted(captured.supersampled, 'supersampled image')} drawn" if captured.supersampled else ""
    print(
        f"{printable(request.output)}: {counted(captured.drawn, 'frame')} drawn{kept}{truth} in {seconds:.1f} s"
        f" with {captured.backend} ({captured.opengl})",
        file=sys.stderr,
    )
