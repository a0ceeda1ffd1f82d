"""``cltaa demo``: capture a scene, resolve it and measure the gain."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cltaa.commands.options import FILE_PATH, SCENE, SIZE, device_option, json_option
from cltaa.commands.printing import answer, figures, print_line, print_table
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Image
from cltaa.io.display import side_by_side, to_picture, write_png
from cltaa.io.sequence import ImageSequence, open_images, open_sequence
from cltaa.io.video import import_av, write_pairs
from cltaa.lab.judge.metrics import equal_quality_samples, mean_of, measure, named_metrics
from cltaa.pipeline.run import ResolveReport, resolve_sequence
from cltaa.printable import counted, shown
from cltaa.process import call_cltaa, stop_signals

SETTLED = 8  # first judged frame, because the history needs some frames to fill
FLIP_EVERY = 8  # FLIP is slower than the resolve, so only every 8th frame is judged by it
ZOOM = 4  # magnification of the crop
TRUTH_SAMPLES = 32


@click.command("demo")
@click.option("-o", "--output", type=FILE_PATH, default=Path("demo"), help="Folder for all that the demo writes.")
@click.option("--scene", type=SCENE, default="spinner", help="Scene to capture; cltaa scenes lists them.")
@click.option("--frames", type=click.IntRange(min=SETTLED + 1), default=40, help="Number of frames to capture.")
@click.option("--size", type=SIZE, default="640x360", help="Size of a frame in pixels.")
@device_option
@json_option
def demo(output: Path, scene: str, frames: int, size: tuple[int, int], device: str | None, as_json: bool) -> None:
    """Capture a scene with its truth, resolve it, write pictures and a film, and print a table of the gain.

    A second run reuses the captured frames and only resolves them again.
    """
    folder, resolved = output / "sequence", output / "resolved"
    if min(size) < ZOOM:
        expected, found = f"at least {ZOOM} pixels a side, of which the crop shows some", f"{size[0]} x {size[1]}"
        raise UsageError("--size: too small", expected=expected, found=found)
    if any(output.glob("*.exr")):
        raise UsageError("the folder holds frames", path=output, cure="choose another one for the demo")
    named_metrics(("mse", "psnr", "flip"))
    import_av()
    resolver = Resolver(device=device)  # fails for a missing device before the work, not after it
    _capture(scene, folder, frames, size, as_json=as_json)
    sequence = open_sequence(folder).select(0, frames - 1)
    report = resolve_sequence(sequence, resolved, resolver, restart=True, stopping=stop_signals())
    before, after = (open_images(place).select(0, frames - 1) for place in (folder, resolved))
    assert sequence.reference is not None
    gain = _judge(before, after, sequence.reference, report)
    _show(output, before, after)
    answer(gain, as_json, lambda gain: _print(gain, report, output))


def _capture(scene: str, folder: Path, frames: int, size: tuple[int, int], *, as_json: bool) -> None:
    """Run ``cltaa capture`` in a separate process, so that no process loads both OpenGL and OpenCL."""
    asked = ["--frames", str(frames), "--size", f"{size[0]}x{size[1]}", "--reference", str(TRUTH_SAMPLES)]
    arguments = ["capture", scene, "-o", str(folder), *asked, *["--json"] * as_json]
    begun = folder.exists()
    done = call_cltaa(arguments)
    if done.returncode == UsageError.exit_code and begun:
        click.echo("cltaa: the folder is the demo's own: captured anew", err=True)
        done = call_cltaa([*arguments, "--restart"])
    if done.returncode:
        click.echo(done.stdout, nl=False)
        click.get_current_context().exit(done.returncode)  # the child process has printed why


def _judge(before: ImageSequence, after: ImageSequence, truth: ImageSequence, report: ResolveReport) -> dict[str, Any]:
    """Return the results of the demo: means over the frames from ``SETTLED`` on, and what the resolve took."""
    one, resolved = _scores(before, truth), _scores(after, truth)
    seconds = report.seconds
    return {
        "psnr_one_sample": one["psnr"],
        "psnr_resolved": resolved["psnr"],
        "flip_one_sample": one["flip"],
        "flip_resolved": resolved["flip"],
        "equal_quality_samples": equal_quality_samples(resolved["mse"], one["mse"], truth_samples=TRUTH_SAMPLES),
        "resolve_ms": 1e3 * (seconds.upload + seconds.kernels + seconds.read_back),
        "device": report.device,
    }


def _scores(images: ImageSequence, truth: ImageSequence) -> dict[str, float]:
    """Return the mean of each metric."""
    values: dict[str, list[float]] = {}
    for number in range(SETTLED, len(truth)):
        metrics = "mse,psnr,flip" if number % FLIP_EVERY == 0 else "mse,psnr"
        for name, value in measure(images.image(number), truth.image(number), metrics).items():
            values.setdefault(name, []).append(value)
    return {name: mean_of(name, of_frames) for name, of_frames in values.items()}


def _show(output: Path, before: ImageSequence, after: ImageSequence) -> None:
    """Write pictures of the last frame and a film of all frames."""
    left, right = before.image(after.last), after.image(after.last)
    write_png(output / "before.png", to_picture(left))
    write_png(output / "after.png", to_picture(right))
    write_png(output / "crop.png", side_by_side(_crop(left), _crop(right)))
    write_pairs(output / "side-by-side.mp4", before, after, rate=24)


def _crop(image: Image) -> Image:
    """Crop the middle of an image and magnify it ``ZOOM`` times without interpolation."""
    height, width = (size // ZOOM for size in image.shape[:2])
    top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    return image[top : top + height, left : left + width].repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)


def _print(gain: Mapping[str, Any], report: ResolveReport, output: Path) -> None:
    frames = counted(report.frames, "frame")
    title = f"{frames}, {report.width} x {report.height}, judged from frame {SETTLED} on"
    table = figures(title, "", "one sample", "resolved", named=True)
    table.add_row("PSNR, dB (more is better)", f"{gain['psnr_one_sample']:.2f}", f"[bold]{gain['psnr_resolved']:.2f}")
    table.add_row("FLIP (less is better)", f"{gain['flip_one_sample']:.4f}", f"[bold]{gain['flip_resolved']:.4f}")
    table.add_row("samples a pixel for the same error", "1", f"[bold]{gain['equal_quality_samples']:.1f}")
    table.add_row("resolve, ms a frame", "", f"{gain['resolve_ms']:.1f}")
    print_table(table)
    print_line(f"resolved on {shown(gain['device'])}")
    for name in ("before.png", "after.png", "crop.png", "side-by-side.mp4", "sequence", "resolved"):
        folder = os.sep if (output / name).is_dir() else ""
        print_line(f"  {shown(output / name)}{folder}")
