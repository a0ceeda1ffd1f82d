"""``cltaa bench kernels``, ``devices``, ``api`` and ``files``: times, each beside a baseline."""

from __future__ import annotations

from pathlib import Path

import click

from cltaa.commands.options import FILE_PATH, PRESET, SIZE, device_option, json_option, open_each, reading_options
from cltaa.commands.printing import answer, figures, print_line, print_table, three_digits
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.inputs.open import Reading
from cltaa.io.exr_layout import check_lossless
from cltaa.lab.bench.api import ApiBench, bench_api
from cltaa.lab.bench.devices import ShapesBench, bench_shapes, forget_shapes
from cltaa.lab.bench.files import FilesBench, bench_files
from cltaa.lab.bench.kernels import KernelBench, Timing, bench_kernels
from cltaa.lab.timing import Interval, Motion
from cltaa.printable import counted, shown


@click.command("kernels")
@click.option("--preset", "presets", type=PRESET, multiple=True, default=["default"], help="Timed preset; repeatable.")
@click.option("--size", type=SIZE, default="1920x1080", help="Frame size in pixels.")
@device_option
@click.option(
    "--motion",
    "motions",
    multiple=True,
    type=click.Choice([kind.value for kind in Motion]),
    help="Camera motion: uniform, or turn (rotation and zoom: each pixel has another displacement); repeatable.  "
    "[default: both]",
)
@click.option("--rounds", default=31, type=click.IntRange(min=3), help="Number of rounds, each over all contenders.")
@json_option
def kernels(
    presets: tuple[str, ...],
    size: tuple[int, int],
    device: str | None,
    motions: tuple[str, ...],
    rounds: int,
    as_json: bool,
) -> None:
    """Time the resolve's kernels against a shader, a plain port and the copy bandwidth.

    "core" is the algorithm that shader and port compute too: 3x3 variance, the nearest surface's motion, 16 taps of
    Catmull-Rom, clip, weighted blend, a counter. Every round runs all contenders in a new order. Ratios are medians
    over rounds with 95 % intervals, by the device's clock if it has one (column device, ns a pixel), else by the host's
    (ns/px). "floor" is the share of the copy bandwidth that a contender reaches. "core again" is a copy of the core: if
    its ratio is not 1 or its interval is wide, the machine is too noisy to rank anything.
    """
    bench = bench_kernels(
        [load_preset(name) for name in presets],
        device,
        width=size[0],
        height=size[1],
        motions=[Motion(name) for name in motions] or list(Motion),
        rounds=rounds,
    )
    answer(bench, as_json, _print_kernels)


def _print_kernels(bench: KernelBench) -> None:
    """Print one table for each kind of motion, and the environment of the measurement."""
    for timing in bench.timings:
        _print_timing(bench, timing)
        print_line(f"floor {timing.floor_ns:.3g} ns a pixel: {timing.copy_gigabytes_a_second:.3g} GB/s by copying")
        if timing.opengl is not None:
            print_line(f"GLSL by {shown(timing.opengl)}")
        for name, why in timing.absent.items():
            print_line(f"{name} is absent: {shown(why)}")
        if timing.noisy or timing.device_noisy:
            print_line("too noisy to rank: the core differs from its own copy, or by more than 2 % either way")
    print_line(shown(bench.environment.line))


def _print_timing(bench: KernelBench, timing: Timing) -> None:
    title = f"{bench.width} x {bench.height}, {timing.motion} motion, {bench.rounds} rounds"
    table = figures(title, "contender", "ns/px", "least", "device", "GB/s", "floor", "x core", "95 %", named=True)
    for row in timing.rows:
        # By the device's clock if it has one, else by the host's.
        ratio, noisy = (row.ratio, timing.noisy)
        if row.device_ratio is not None:
            ratio, noisy = (row.device_ratio, timing.device_noisy)
        table.add_row(
            row.name,
            three_digits(row.wall_ns.median),
            three_digits(row.least_wall_ns),
            "–" if row.device_ns is None else three_digits(row.device_ns.median),
            f"{row.gigabytes_a_second:.3g}",
            f"{row.of_floor:.1%}",
            "noisy" if noisy else f"{ratio.median:.3g}",
            _range(ratio, ".3g"),
        )
    print_table(table)


@click.command("devices")
@device_option
@click.option("--forget", is_flag=True, help="Remove the stored answers of all devices and measure nothing.")
@json_option
def devices(device: str | None, forget: bool, as_json: bool) -> None:
    """Find the fastest kernel shape (lanes, rows, registers ...) for a device, and store it for later resolves.

    Use it where cltaa doctor says that the device's shape is a guess. The default preset runs in each of a few shapes,
    in rounds. The usual shape stays unless another is 5 % faster, beyond chance. The answer applies to this device,
    runtime, processor and version of the kernels, and changes no bit of a strict build.
    """
    if forget:
        told = {"forgotten": forget_shapes()}
        answer(told, as_json, lambda found: print_line(f"forgotten: {counted(found['forgotten'], 'shape')}"))
    else:
        answer(bench_shapes(device), as_json, _print_devices)


def _print_devices(bench: ShapesBench) -> None:
    table = figures(None, "shape", "lanes", "ms for two frames", "x usual", "95 %", named=True)
    for row in bench.rows:
        cells = [row.shape, str(row.lanes)]
        if row.seconds is not None and row.ratio is not None:
            cells += [three_digits(row.seconds.median * 1e3), f"{row.ratio.median:.3g}", _range(row.ratio, ".3g")]
        table.add_row(*cells)
    print_table(table)
    for row in bench.rows:
        if row.absent is not None:
            print_line(f"{row.shape} is absent: {shown(row.absent)}")
    print_line(f"usual: {bench.usual}, {bench.origin}; taken from now on: {bench.taken}, kept in {shown(bench.kept)}")
    print_line(shown(bench.environment.line))


@click.command("api")
@click.option("--preset", type=PRESET, default="default", help="Preset to resolve with.")
@click.option(
    "--size",
    "sizes",
    type=SIZE,
    multiple=True,
    default=["1920x1080", "3840x2160"],
    help="Frame size in pixels; repeatable.",
)
@device_option
@click.option("--rounds", default=9, type=click.IntRange(min=3), help="Number of rounds for each size.")
@json_option
def api(preset: str, sizes: tuple[tuple[int, int], ...], device: str | None, rounds: int, as_json: bool) -> None:
    """Time Resolver.resolve as a program calls it, in milliseconds a frame of colour and depth.

    "kernels" is the device's own time for a call whose arrays are on the device already. "device arrays" is the wall
    time of such calls, several in a row. "host arrays" takes and returns NumPy arrays, "pinned arrays" those of
    Resolver.empty. "copies" is a plain pyopencl loop that copies the same arrays to the device and a result back;
    "pinned copies" does so in pinned memory, at the speed of the bus.
    """
    preset_of = load_preset(preset)
    if preset_of.settings.look_ahead:
        raise UsageError(f"preset {preset} looks ahead, so no call gives an image", cure="take one that does not")
    answer(bench_api(preset_of, device, sizes, rounds=rounds), as_json, _print_api)


def _print_api(bench: ApiBench) -> None:
    title = f"a call, preset {bench.preset}, {bench.rounds} rounds, milliseconds a frame"
    ways = ("kernels", "device arrays", "host arrays", "pinned arrays", "copies", "pinned copies")
    table = figures(title, "size", *ways)
    for row in bench.rows:
        arrays = (row.device_arrays, row.host_arrays, row.pinned_arrays)
        times = (row.kernels, *arrays, row.copies, row.pinned_copies)
        table.add_row(f"{row.width} x {row.height}", *(f"{time.median * 1e3:.3g}" for time in times))
    print_table(table)
    print_line(shown(bench.environment.line))


@click.command("files")
@click.argument("sequence", type=FILE_PATH)
@click.option("--preset", type=PRESET, default="default", help="Preset to resolve with.")
@device_option
@click.option("--half", is_flag=True, help="Write half-precision EXRs.")
@click.option("--compression", default="zip", help="Lossless EXR compression.")
@click.option("--rounds", default=5, type=click.IntRange(min=3), help="Number of rounds.")
@reading_options
@json_option
def files(
    sequence: Path,
    preset: str,
    device: str | None,
    half: bool,
    compression: str,
    rounds: int,
    reading: Reading,
    as_json: bool,
) -> None:
    """Time the whole resolve of SEQUENCE against its stages.

    "alone" is one stage by itself: reading (with all checks), resolving (with transfers to the device and back) and
    writing. "whole" is cltaa resolve --layers none, where the stages overlap. "over slowest" is its time a frame
    divided by that of the slowest stage; 1 is the least it can reach. "at best" is that ratio if no core were ever
    idle, from the "processor" time of all cores together.
    """
    check_lossless(compression)
    opened = open_each([sequence], reading)[sequence]
    found = bench_files(opened, load_preset(preset), device, compression=compression, half=half, rounds=rounds)
    answer(found, as_json, _print_files)


def _print_files(found: FilesBench) -> None:
    title = f"cltaa resolve, {counted(found.frames, 'frame')}, milliseconds a frame"
    alone = [f"{stage} alone" for stage in ("read", "resolve", "write")]
    table = figures(title, "compression", *alone, "whole", "processor", "over slowest", "95 %", "at best")
    seconds = (found.read, found.resolve, found.write, found.whole, found.processor)
    table.add_row(
        found.compression + (", half" if found.half else ""),
        *(f"{value.median * 1e3:.0f}" for value in seconds),
        f"{found.over_slowest.median:.2f}",
        _range(found.over_slowest, ".2f"),
        f"{found.at_best.median:.2f}",
    )
    print_table(table)
    print_line(shown(found.environment.line))


def _range(value: Interval, form: str = ".0f") -> str:
    return f"{value.low:{form}}–{value.high:{form}}"
