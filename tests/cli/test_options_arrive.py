"""Every option of every command arrives at what it is for: each is given once, and recorded where the work begins."""

from __future__ import annotations

import importlib
import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import MagicMock

import click
import pytest

from cltaa.cli import root
from cltaa.core.build import Storage
from cltaa.core.debug import View
from cltaa.core.parameters import Fireflies
from cltaa.core.presets import load_preset
from cltaa.io.numbered import OnBreak
from cltaa.io.sequence import FrameSequence

SCENES = ("spinner", "wires")
REAL = object()  # what is recorded and called all the same


class Arrived(Exception):
    """The work would begin here."""


def begins(*_: object, **__: object) -> None:
    raise Arrived


def sequence(*_: object, **__: object) -> MagicMock:
    made = MagicMock(notes=(), width=64, height=32, region=None, without_truth=())
    made.__class__ = FrameSequence  # type: ignore[assignment]
    return made


def opened(folders: list[Path], _: object) -> dict[Path, str]:
    return {folder: folder.name for folder in folders}


class Command(NamedTuple):
    """A command line that is short of options, and what is recorded of what it calls, with a stand-in for each."""

    line: str
    calls: Mapping[str, Any]


COMMANDS = {
    "resolve": Command(
        "resolve seq -o out",
        {
            "cltaa.commands.resolve.open_input": sequence,
            "cltaa.pipeline.folder.arrivals_of": begins,
            "cltaa.pipeline.folder.check_declared": lambda *_: None,
            "cltaa.pipeline.folder.denoiser": lambda *_: None,
            "cltaa.pipeline.folder.chosen_layers": lambda *_: ("carried",),
            "cltaa.pipeline.folder.carried_kinds": lambda *_: {},
            "cltaa.pipeline.folder.carried_compression": lambda *_: "piz",
            "cltaa.pipeline.folder.devices_of": lambda device, jobs: [device] * jobs,
            "cltaa.pipeline.folder.resolver_for": sequence,
            "cltaa.pipeline.cluster.connected": nullcontext,
            "cltaa.pipeline.cluster.Cluster": begins,
            "cltaa.pipeline.folder.resolve_sequence": begins,
        },
    ),
    "inspect": Command(
        "inspect seq",
        {
            "cltaa.lab.inspect.findings.is_own": lambda *_: True,
            "cltaa.commands.inspect.open_input": sequence,
            "cltaa.lab.inspect.findings.describe_input": begins,
            "cltaa.lab.inspect.findings.inspect_folder": begins,
            "cltaa.commands.inspect.plan": begins,
        },
    ),
    "check": Command(
        "check seq",
        {"cltaa.commands.check.check_creatable": lambda *_: None, "cltaa.commands.check.check_folder": begins},
    ),
    "compare": Command(
        "compare seq truth",
        {
            "cltaa.commands.compare.pair_up": lambda *_, **__: [sequence()],
            "cltaa.commands.compare.doubts": lambda *_, **__: [],
            "cltaa.commands.compare.even_step": lambda *_: 1,
            "cltaa.commands.compare.stale_maps": lambda *_: [],
            "cltaa.commands.compare.judge": begins,
            "cltaa.commands.compare.judged_entries": begins,
        },
    ),
    "tune": Command(
        "tune a b -o out.toml --budget 5ms",
        {
            "cltaa.commands.tune.open_each": opened,
            "cltaa.commands.tune.launcher_for": lambda device: f"launcher {device}",
            "cltaa.commands.tune.parse_goal": lambda *_: "goal",
            "cltaa.commands.tune.tune": begins,
        },
    ),
    "demo": Command(
        "demo",
        {
            "cltaa.commands.demo.call_cltaa": lambda _: SimpleNamespace(returncode=0),
            "cltaa.commands.demo.Resolver": sequence,
            "cltaa.commands.demo.open_sequence": sequence,
            "cltaa.commands.demo.resolve_sequence": begins,
        },
    ),
    "bench accuracy": Command(
        "bench accuracy seq -o out",
        {
            "cltaa.commands.bench_accuracy.chosen_variants": lambda *_, **__: ["variant"],
            "cltaa.commands.bench_accuracy.tasks_of": lambda *_: ["task 0", "task 1"],
            "cltaa.commands.bench_accuracy.open_each": opened,
            "cltaa.commands.bench_accuracy.bench_accuracy": lambda *_, **__: "result",
            "cltaa.commands.bench_accuracy.page": lambda *_: "page",
            "cltaa.commands.bench_accuracy.write_report": begins,
        },
    ),
    "bench quality": Command(
        "bench quality --scene spinner",
        {
            "cltaa.commands.bench_quality.import_judges": lambda: None,
            "cltaa.commands.bench_quality.check_pages": lambda *_: None,
            "cltaa.commands.bench_quality.check_judged": lambda *_: None,
            "cltaa.commands.bench_quality.known_scenes": lambda: dict.fromkeys(SCENES, frozenset({"motion"})),
            "cltaa.commands.bench_quality.chosen_presets": REAL,
            "cltaa.commands.bench_quality.planned": REAL,
            "cltaa.commands.bench_quality.open_each": lambda folders, _: {folder: sequence() for folder in folders},
            "cltaa.commands.bench_quality.open_case": lambda _: None,
            "cltaa.commands.bench_quality.capture": sequence,
            "cltaa.commands.bench_quality.Reading": lambda **_: MagicMock(open=sequence),
            "cltaa.commands.bench_quality.launcher_of": lambda device: f"launcher {device}",
            "cltaa.commands.bench_quality.task_of": lambda *_: MagicMock(finished=lambda _: {}),
            "cltaa.commands.bench_quality.run_all": lambda *_: (),
            "cltaa.commands.bench_quality.summarise": sequence,
            "cltaa.commands.bench_quality.about_of": lambda *_: "about",
            "cltaa.commands.bench_quality.write_pictures": begins,
            "cltaa.commands.bench_quality.write_pages": begins,
        },
    ),
    "bench kernels": Command("bench kernels", {"cltaa.commands.bench_times.bench_kernels": begins}),
    "bench devices": Command(
        "bench devices",
        {
            "cltaa.commands.bench_times.bench_shapes": begins,
            "cltaa.commands.bench_times.forget_shapes": begins,
        },
    ),
    "bench files": Command(
        "bench files seq",
        {"cltaa.commands.bench_times.open_each": opened, "cltaa.commands.bench_times.bench_files": begins},
    ),
    "bench api": Command("bench api", {"cltaa.commands.bench_times.bench_api": begins}),
    "raycast": Command("raycast rolling -o out", {"cltaa_datasets.ray_cast.draw": begins}),
    "capture": Command("capture spinner -o out", {"cltaa_capture.sequence.capture_sequence": begins}),
    "kernels": Command("kernels --show resolve", {"cltaa.commands.presets.source": begins}),
    "presets": Command(
        "presets fast",
        {"cltaa.commands.presets.difference": begins, "cltaa.commands.presets.parameter_rows": begins},
    ),
}

CHANGED = "preset.settings.depth_tolerance"  # what config.toml and --set change


def frames_that_are_read(call: str, *, judged: bool = False) -> list[tuple[str, str, object]]:
    """How to read them, as one argument ``reading`` of ``call``."""
    rows: list[tuple[str, str, object]] = [
        ("--profile blender", f"{call}.reading.profile", "blender"),
        ("--input motion.scale=3,4", f"{call}.reading.assignments", ("motion.scale=3,4",)),
        ("--camera side.json", f"{call}.reading.side_file", "side.json"),
        ("--step 3", f"{call}.reading.step", 3),
        ("--effects motion", f"{call}.reading.effects", "motion"),
        ("--effects none", f"{call}.reading.effects", ""),
    ]
    return [*rows, ("--truth other", f"{call}.reading.truth", "other")] if judged else rows


def frames_that_are_opened(call: str, more: str = "") -> list[tuple[str, str, object]]:
    """How to read them, as arguments of ``call``."""
    return [
        (f"--profile blender {more}", f"{call}.profile", "blender"),
        (f"--profile blender --input motion.scale=3,4 {more}", f"{call}.assignments", ("motion.scale=3,4",)),
        (f"--camera side.json {more}", f"{call}.side_file", Path("side.json")),
        (f"--profile blender --step 3 {more}", f"{call}.step", 3),
    ]


# command -> options, the argument of a recorded call where they arrive, and what it is there
ROWS: dict[str, list[tuple[str, str, object]]] = {
    "resolve": [
        ("-o elsewhere", "resolve_sequence.output", Path("elsewhere")),
        ("--preset basic", "resolver_for.preset.name", "basic"),
        ("--config config.toml", f"resolver_for.{CHANGED}", 0.375),
        ("--set depth_tolerance=0.625", f"resolver_for.{CHANGED}", 0.625),
        ("--look-ahead 7", "resolver_for.preset.settings.look_ahead", 7),
        ("--preset gather-8 --jobs 7", "devices_of.jobs", 7),
        ("--preset gather-8 --jobs 7", "resolver_for.jobs", 7),
        ("--preset gather-8 --dask there", "connected.address", "there"),
        ("--preset gather-8 --dask there --jobs 7", "Cluster.jobs", 7),
        ("--preset gather-8 --dask there --device 3", "Cluster.tool.device", "3"),
        ("--device 3", "resolver_for.device", "3"),
        ("--effects motion", "check_declared.effects", {"motion"}),
        ("--effects motion", "resolve_sequence.effects", {"motion"}),
        ("--effects none", "resolve_sequence.effects", frozenset()),
        ("--frames 3-5", "open_input.frames", (3, 5)),
        ("--follow --frames 3-5", "arrivals_of.reading.frames", (3, 5)),
        ("--follow --idle 7s", "arrivals_of.idle", 7.0),
        ("--preview film.mp4", "resolve_sequence.preview", Path("film.mp4")),
        ("--preview film.mp4 --compare wipe", "resolve_sequence.compare", "wipe"),
        ("--half", "resolver_for.half", True),
        ("--half", "resolve_sequence.half", True),
        ("--compression zips", "resolve_sequence.compression", "zips"),
        ("--layers one,two", "chosen_layers.names", ("one", "two")),
        ("--storage half", "resolver_for.storage", Storage.HALF),
        ("--strict", "resolver_for.strict", True),
        *frames_that_are_opened("open_input"),
        ("--no-verify", "open_input.verify", False),
        ("--band-rows 7", "resolver_for.band_rows", 7),
        ("--gaps reset", "open_input.gaps", OnBreak("reset")),
        ("--on-resize reset", "open_input.on_resize", OnBreak("reset")),
        ("--fireflies clamp", "resolver_for.preset.choices.fireflies", Fireflies.CLAMP),
        ("--denoise oidn", "resolve_sequence.denoise", "oidn"),
        ("--restart", "resolve_sequence.restart", True),
        ("--checkpoint 7", "resolve_sequence.checkpoint_every", 7),
        ("--debug count", "resolve_sequence.debug", (View("count"),)),
    ],
    "inspect": [
        ("--pixels", "inspect_folder.pixels", True),
        ("--pixels --profile blender", "describe_input.pixels", True),
        ("--step 3", "inspect_folder.step", 3),
        ("--frames 3-5", "inspect_folder.frames", (3, 5)),
        ("--plan --frames 3-5", "open_input.frames", (3, 5)),
        *frames_that_are_opened("describe_input"),
        *frames_that_are_opened("open_input", "--plan"),
        ("--plan", "plan.device", None),
        ("--plan --preset basic", "plan.preset.name", "basic"),
        ("--plan --device 3", "plan.device", "3"),
        ("--plan --effects motion", "plan.effects", {"motion"}),
        ("--plan --config config.toml", f"plan.{CHANGED}", 0.375),
        ("--plan --set depth_tolerance=0.625", f"plan.{CHANGED}", 0.625),
        ("--plan --storage half", "plan.storage", Storage.HALF),
        ("--plan --band-rows 7", "plan.band_rows", 7),
        ("--plan --half", "plan.half", True),
        ("--plan --jobs 7", "plan.jobs", 7),
        ("--plan --denoise oidn", "plan.denoise", "oidn"),
        ("--plan --denoise oidn", "plan.preset.choices.current_filter", "none"),
        ("--plan --layers one,two", "plan.layers", ("one", "two")),
    ],
    "check": [
        *frames_that_are_opened("check_folder"),
        ("--frames 3-5", "check_folder.frames", (3, 5)),
        ("--fix mended.toml", "check_creatable.path", Path("mended.toml")),
        ("--jitter-file jitter.json", "check_creatable.path", Path("jitter.json")),
    ],
    "compare": [
        ("--metrics flip", "judge.metrics.0.name", "flip"),
        ("--frames 3-5", "pair_up.frames", (3, 5)),
        ("--stops 2", "judge.stops", 2.0),
        ("--heatmap maps", "judge.heatmap", Path("maps")),
        ("--video", "judge.in_time", True),
        *frames_that_are_opened("pair_up"),
        ("--no-verify", "pair_up.verify", False),
        ("--table --ours basic,karis", "judged_entries.ours", ("basic", "karis")),
        ("--table --stops 2", "judged_entries.stops", 2.0),
        ("--table --no-verify", "judged_entries.verify", False),
        ("--table --cvvdp", "judged_entries.cvvdp", True),
        ("--table --film films", "judged_entries.film", Path("films")),
        ("--table --frames 3-5", "judged_entries.frames", (3, 5)),
    ],
    "tune": [
        ("--budget 7ms", "parse_goal.budget", "7ms"),
        ("--target flip=0.5", "parse_goal.target", "flip=0.5"),
        ("--metric flip", "parse_goal.metric", "flip"),
        ("--check c", "tune.checked", ["c"]),
        ("--check c", "tune.searched", ["a", "b"]),
        ("--preset basic", "tune.base.name", "basic"),
        ("--config config.toml", "tune.base.settings.depth_tolerance", 0.375),
        ("--trials 7", "tune.trials", 7),
        ("--seed 7", "tune.seed", 7),
        ("--device 3", "tune.launcher", "launcher 3"),
        ("-o elsewhere.toml", "tune.output", Path("elsewhere.toml")),
        *frames_that_are_read("open_each", judged=True),
    ],
    "demo": [
        ("-o elsewhere", "resolve_sequence.output", Path("elsewhere/resolved")),
        ("--scene wires", "call_cltaa.arguments.1", "wires"),
        ("--frames 12", "call_cltaa.arguments.5", "12"),
        ("--size 40x30", "call_cltaa.arguments.7", "40x30"),
        ("--device 3", "Resolver.device", "3"),
    ],
    "bench accuracy": [
        ("-o elsewhere", "bench_accuracy.output", Path("elsewhere")),
        ("-o elsewhere", "write_report.output", Path("elsewhere")),
        ("--device 3", "tasks_of.device", "3"),
        ("--preset basic", "chosen_variants.preset.name", "basic"),
        ("--config config.toml", f"chosen_variants.{CHANGED}", 0.375),
        ("--only build", "chosen_variants.only", ("build",)),
        ("--metrics psnr", "tasks_of.judging.metrics", ("psnr",)),
        ("--rounding-frames 7", "tasks_of.judging.rounding_frames", 7),
        ("--rounds 7", "bench_accuracy.rounds", 7),
        ("--patience 7", "bench_accuracy.patience", 7.0),
        ("--pixels 7", "bench_accuracy.pixels", 7),
        ("--jobs 7", "bench_accuracy.jobs", 7),
        ("--dask there", "bench_accuracy.dask", "there"),
        ("--pictured 7", "page.pictured", 7),
        *frames_that_are_read("tasks_of", judged=True),
        *frames_that_are_read("open_each", judged=True),
    ],
    "bench quality": [
        ("--scene wires", "planned.scenes.wires", REAL),
        ("--sequence there", "open_each.folders", (Path("there"),)),
        ("--preset basic", "chosen_presets.names", ("basic",)),
        ("--config config.toml", "chosen_presets.configs", (Path("config.toml"),)),
        ("--device 3", "task_of.device", "3"),
        ("--size 40x30", "capture.shape.height", 30),
        ("--frames 12", "capture.shape.frames", 12),
        ("--samples 7", "capture.shape.samples", 7),
        ("--jitter grid:9", "capture.shape.jitter", "grid:9"),
        ("--train 5", "planned.seeds", {5: "train", 1: "held-out"}),
        ("--held-out 5", "planned.seeds", {0: "train", 5: "held-out"}),
        ("--sequence there --settled 3", "check_judged.settled", 3),
        ("--settled 3", "task_of.judging.settled", 3),
        ("--work elsewhere", "planned.work", Path("elsewhere/sequences")),
        ("--work elsewhere", "run_all.output", Path("elsewhere")),
        ("--page page.md", "check_pages.page", Path("page.md")),
        ("--page page.md", "write_pages.page", Path("page.md")),
        ("--pictures maps", "write_pictures.output", Path("maps")),
        *(
            (f"--sequence there {row}", path, value)
            for row, path, value in frames_that_are_read("open_each", judged=True)
        ),
    ],
    "bench kernels": [
        ("--preset basic", "bench_kernels.presets.0.name", "basic"),
        ("--size 40x30", "bench_kernels.height", 30),
        ("--device 3", "bench_kernels.device", "3"),
        ("--motion turn", "bench_kernels.motions", ["turn"]),
        ("--rounds 7", "bench_kernels.rounds", 7),
    ],
    "bench devices": [
        ("--device 3", "bench_shapes.device", "3"),
        ("--forget", "forget_shapes", {}),
    ],
    "bench files": [
        ("--preset basic", "bench_files.preset.name", "basic"),
        ("--device 3", "bench_files.device", "3"),
        ("--half", "bench_files.half", True),
        ("--compression rle", "bench_files.compression", "rle"),
        ("--rounds 7", "bench_files.rounds", 7),
        *frames_that_are_read("open_each"),
    ],
    "bench api": [
        ("--preset basic", "bench_api.preset.name", "basic"),
        ("--size 7x8", "bench_api.sizes", ((7, 8),)),
        ("--device 3", "bench_api.device", "3"),
        ("--rounds 7", "bench_api.rounds", 7),
    ],
    "raycast": [
        ("-o elsewhere", "draw.output", Path("elsewhere")),
        ("--frames 12", "draw.frames", 12),
        ("--size 40x30", "draw.size", (40, 30)),
        ("--period 7", "draw.period", 7),
        ("--reference 7", "draw.reference", 7),
        ("--seed 7", "draw.seed", 7),
    ],
    "capture": [
        ("-o elsewhere", "capture_sequence.request.output", Path("elsewhere")),
        ("--frames 12", "capture_sequence.request.frames", 12),
        ("--size 40x30", "capture_sequence.request.height", 30),
        ("--jitter grid:9", "capture_sequence.request.jitter", "grid:9"),
        ("--reference 7", "capture_sequence.request.reference", 7),
        ("--yardstick 7", "capture_sequence.request.yardstick", (7,)),
        ("--seed 7", "capture_sequence.request.seed", 7),
        ("--fps 7", "capture_sequence.request.fps", 7.0),
        ("--motion orbit", "capture_sequence.request.motion", "orbit"),
        ("--backend egl", "capture_sequence.request.backend", "egl"),
        ("--restart", "capture_sequence.request.restart", True),
    ],
    "kernels": [
        ("--show gather", "source.kernel", "gather"),
        ("--preset basic", "source.build.choices", load_preset("basic").choices),
        ("--lanes 4", "source.build.lanes", 4),
        ("--strict", "source.build.strict", True),
    ],
    "presets": [
        ("--against basic", "difference.other.name", "basic"),
        ("--parameters", "parameter_rows.preset.name", "fast"),
    ],
}
# command -> what it gives a function though no option says so, and though the function has a default
OTHERWISE = {
    # those of the input; a program's signals are its own
    "resolve": {
        "resolve_sequence.compression",
        "resolve_sequence.layers",
        "resolve_sequence.stopping",
    },
    "demo": {"resolve_sequence.restart", "resolve_sequence.stopping"},  # the folder is the demo's own
    "bench accuracy": {"page.pictured"},
    "bench quality": {"Reading.effects", "task_of.reading"},
    "capture": {"capture_sequence.progress"},
}
# Of --json every command has a test of its answer (test_nonsense.py and that of the command).
ANSWERS = {"--json"}


def commands(command: click.Command = root, name: str = "") -> Iterator[tuple[str, click.Command]]:
    """Every command of the command line that does work."""
    if isinstance(command, click.Group):
        ctx = click.Context(command)
        for each in command.list_commands(ctx):
            found = command.get_command(ctx, each)
            assert found is not None
            yield from commands(found, f"{name} {each}".strip())
    else:
        yield name, command


def recorder(real: Callable[..., Any], calls: dict[str, Any], name: str, stand_in: Any) -> Callable[..., Any]:
    signature = inspect.signature(real)

    def record(*arguments: object, **keywords: object) -> Any:
        bound = signature.bind(*arguments, **keywords)
        bound.apply_defaults()
        for parameter in signature.parameters.values():
            if parameter.kind is inspect.Parameter.VAR_KEYWORD:
                bound.arguments |= bound.arguments.pop(parameter.name)
        calls[name] = bound.arguments
        return real(*arguments, **keywords) if stand_in is REAL else stand_in(*arguments, **keywords)

    return record


def calls_of(name: str, options: str, patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The arguments of every call that a command makes, by the names of the functions."""
    line = COMMANDS[name].line
    calls: dict[str, Any] = {}
    with patch.context() as patched:
        for path, stand_in in COMMANDS[name].calls.items():
            module, _, function = path.rpartition(".")
            real = getattr(importlib.import_module(module), function)
            patched.setattr(path, recorder(real, calls, function, stand_in))
        try:
            root.main(shlex.split(f"{line} {options}"), standalone_mode=False)
        except Arrived:
            return calls
    return calls


def found(calls: Mapping[str, Any], path: str) -> Any:
    """What stands at ``function.argument.attribute`` of the calls; None where the function was not called."""
    value: Any = calls
    for word in path.split("."):
        if isinstance(value, Mapping):
            value = value.get(word)
        elif word.isdigit():
            value = value[int(word)]
        else:
            value = getattr(value, word, None)
    return value


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.toml").write_text("depth_tolerance = 0.375\n")
    return monkeypatch


@pytest.mark.parametrize("name", ROWS)
def test_every_option_reaches_the_function_behind_its_command(desk: pytest.MonkeyPatch, name: str) -> None:
    without = calls_of(name, "", desk)
    for options, path, value in ROWS[name]:
        arrived = found(calls_of(name, options, desk), path)
        assert (arrived is not None) if value is REAL else (arrived == value), options
        assert found(without, path) != arrived or path.split(".")[0] not in without, options


def test_every_option_is_among_them() -> None:
    forgotten = []
    for name, command in commands():
        words = {word for row in ROWS.get(name, []) for word in row[0].split()}
        for option in command.params:
            if isinstance(option, click.Option) and not ANSWERS & {*option.opts}:
                given = words & {*option.opts, *option.secondary_opts}
                forgotten += [] if given else [f"{name} {option.opts[-1]}"]
    assert forgotten == []


def test_every_number_that_an_option_takes_has_a_least() -> None:
    numbers = click.types.IntParamType | click.types.FloatParamType
    taken = [(name, option) for name, command in commands() for option in command.params]
    counts = [(name, option) for name, option in taken if isinstance(option.type, numbers)]
    assert [f"{name} {option.name}" for name, option in counts if getattr(option.type, "min", None) is None] == []


def test_every_command_answers_as_json_alone() -> None:
    """What is left out above: the commands without any other option."""
    assert {name for name, _ in commands()} - {*ROWS} == {"doctor", "profiles", "scenes"}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_program_gets_by_default_what_a_command_gets(desk: pytest.MonkeyPatch, name: str) -> None:
    """Without options, a command passes what the functions that it calls would take by themselves."""
    other = set()
    calls = calls_of(name, "", desk)
    for path in COMMANDS[name].calls:
        module, _, function = path.rpartition(".")
        for parameter in inspect.signature(getattr(importlib.import_module(module), function)).parameters.values():
            given = calls.get(function, {}).get(parameter.name, parameter.default)
            given = tuple(given) if isinstance(given, list) else given
            if parameter.default is not parameter.empty and given != parameter.default:
                other.add(f"{function}.{parameter.name}")
    assert other == OTHERWISE.get(name, set())
