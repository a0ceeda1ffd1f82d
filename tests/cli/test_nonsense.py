"""Every command, given nonsense: one line on standard error that says what is wrong, the right code, nothing else."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.printable import json_of
from tests.sequence_factory import write_sequence

USAGE, WRONG, DATA, MISSING, OUTPUT, STORAGE, RESOURCE = 2, 64, 65, 66, 73, 74, 75

CASES: list[tuple[str, int, str]] = [
    ("inspect", USAGE, "Missing argument 'SEQUENCE'"),
    ("inspect ''", USAGE, "the name is empty"),
    ("inspect nowhere", MISSING, "nowhere: the folder is missing"),
    ("inspect empty", MISSING, "empty: no frames in the folder"),
    ("inspect pngs", MISSING, "found no EXR, but a.0001.PNG); convert the frames"),
    ("inspect noexr", MISSING, "noexr: no frames in the folder"),
    ("check /dev/null", DATA, "/dev/null: this is a pipe or a device"),
    ("inspect seq/synthetic.0009.exr", MISSING, "seq/synthetic.0009.exr: the file is missing; check the name"),
    ("resolve file.txt -o out", DATA, "file.txt: this is not an EXR file"),
    (
        "resolve seq/synthetc.####.exr -o out",
        MISSING,
        "no file has such a name; name the folder that its frames are in: seq",
    ),
    ("check seq/synthetic.%05d.exr", MISSING, "name the folder that its frames are in: seq"),
    ("inspect seq --preset gather-48", WRONG, "--preset says how to plan a resolve; add --plan"),
    ("inspect seq --half", WRONG, "--half says how to plan a resolve; add --plan"),
    ("inspect seq --plan --pixels", WRONG, "--pixels and --plan are two reports; leave one of them out"),
    ("inspect seq --plan --effects smell", WRONG, "--effects: unknown effect smell"),
    ("inspect seq/synthetic.##.##.exr", WRONG, "only one place in a name is the number of a frame"),
    ("check seq --input recognise.Software=x", WRONG, "--input recognise.Software=x: no such key; known keys: colour."),
    ("check seq --input name=x", WRONG, "--input name=x: no section (expected SECTION.KEY=VALUE"),
    ("inspect seq small", USAGE, "extra argument (small); see"),
    ("check seq/synthetic.0000.exr small", USAGE, "extra argument (small); see"),
    ("resolve nowhere -o out", MISSING, "nowhere: the folder is missing"),
    ("resolve seq -o out --idle 3", WRONG, "--idle needs --follow; give both, or neither"),
    (
        "resolve seq/synthetic.0000.exr seq/synthetic.0001.exr -o out --follow",
        WRONG,
        "not there yet (found a list of files); name the folder, or quote the pattern, as in 'x.####.exr'",
    ),
    ("resolve seq -o out --follow --frames 3", WRONG, "cannot tell yet which frames are the first"),
    (
        "resolve seq -o out --device numpy --preset gather-8 --fireflies clamp",
        WRONG,
        "--fireflies clamp: preset gather-8 gathers and keeps its fireflies",
    ),
    ("resolve seq", USAGE, "Missing option '-o'"),
    ("resolve seq -o out --device ''", WRONG, "the name of a device is empty; leave it out for the first device"),
    ("resolve seq -o out --device numpy --compression ''", WRONG, "unknown or lossy compression (expected"),
    ("resolve seq -o out --layers ''", USAGE, "Invalid value for '--layers': '' names no channel; none keeps none"),
    ("resolve seq -o", USAGE, "requires an argument; see cltaa resolve --help"),
    ("resolve seq -o seq", WRONG, "would overwrite the sequence"),
    ("resolve seq -o out/x.####.exr", WRONG, "results go into a folder, under the names of their inputs; name it "),
    ("resolve linked -o seq --restart", WRONG, "seq: the output would overwrite the sequence"),
    ("resolve seq -o loop", OUTPUT, "; choose another output folder"),
    ("resolve seq -o out --preview loop", WRONG, "loop: a film must be an MP4"),
    (
        "tune loop seq -o t.toml --budget 1ms",
        STORAGE,
        "loop: reading failed: Too many levels of symbolic links; mend",
    ),
    ("resolve small -o small/reference", WRONG, "would be taken for the truth of the sequence; name another folder"),
    ("resolve seq -o seq/reference-8", WRONG, "would be taken for the truth of the sequence"),
    ("resolve seq -o file.txt", OUTPUT, "file.txt: the folder cannot be created"),
    ("resolve seq -o file.txt/x", OUTPUT, "file.txt/x: the folder cannot be created"),
    ("resolve seq -o /proc/x", OUTPUT, "/proc/x: the folder cannot be created"),
    ("resolve seq -o out --device 99", WRONG, "no OpenCL device matches 99"),
    ("resolve seq -o out --config nowhere.toml", MISSING, "nowhere.toml: the file is missing"),
    ("resolve seq -o out --config file.txt", DATA, "file.txt: not TOML"),
    ("resolve seq -o out --config empty", DATA, "empty: this is a folder (expected a TOML file)"),
    ("resolve seq -o out --config /dev/zero", DATA, "/dev/zero: this is a pipe or a device (expected a TOML file)"),
    ("resolve seq -o out --config latin.toml", DATA, "latin.toml: not UTF-8"),
    ("resolve seq -o out --config deep.toml", DATA, "deep.toml: not TOML"),
    (
        "resolve seq -o out --config profile.toml",
        WRONG,
        "unknown key colour; of a reader profile, which --profile take",
    ),
    ("resolve seq -o out --config jitter.toml", WRONG, "jitter.toml: unknown key jitter"),
    ("resolve seq -o out --config large.toml", DATA, "large.toml: too large for a TOML file"),
    ("resolve seq -o out --preset ../../etc/passwd", WRONG, "unknown preset"),
    ("resolve seq -o out --set box_scale_static=nan", WRONG, "box_scale_static"),
    ("resolve seq -o out --set box_scale_static=1e999", WRONG, "box_scale_static"),
    ("resolve seq -o out --set =1", WRONG, "unknown key"),
    ("resolve seq -o out --frames 2-1", WRONG, "the range of frames is empty"),
    ("resolve seq -o out --frames -", USAGE, "is no range of frames, such as 8-47"),
    ("resolve seq -o out --look-ahead 99999", WRONG, "--look-ahead: look_ahead has no such value (expected 0 to 64"),
    ("resolve seq -o out --frames 9-99999999999999999999", WRONG, "no such frame (expected 0-2)"),
    ("resolve seq -o out --config said.toml", WRONG, "published has no such value (expected nothing, article, engine"),
    ("resolve seq -o out --preset deafult", WRONG, "unknown preset deafult; did you mean default?"),
    ("resolve seq -o out --preset mine.toml", WRONG, "take a file by --config, and cltaa.load_preset"),
    ("resolve seq -o out --set bx_scale_static=1", WRONG, "key bx_scale_static; did you mean box_scale_static?"),
    ("resolve seq -o out --set nonsense=1", WRONG, "--set: unknown key nonsense; known keys: "),
    ("resolve seq -o out --set sample_limit=0", WRONG, "no such value (expected 1 to 1048576, found 0)"),
    ("resolve seq -o out --set box_scale_static=-1", WRONG, "box_scale_static has no such value (expected 0 to 64, "),
    ("resolve seq -o out --set history_frames=7.5", WRONG, "has no such value (expected 1 to 64 (whole), found 7.5)"),
    ("resolve seq -o out --set rectify=maybe", WRONG, "rectify has no such value (expected none, clamp, "),
    ("resolve seq -o out --layers dpeth.Z", WRONG, "--layers: no such channel (expected B G R Z, found dpeth.Z)"),
    ("resolve seq -o out --debug rejct", WRONG, "--debug: unknown view rejct; did you mean reject?"),
    ("resolve --debug count,x seq -o out", WRONG, "unknown view x; known views: reject, count, motion, clip"),
    ("resolve seq -o out --debug foo", USAGE, "argument (foo); --debug takes views: reject, count, motion, clip; see"),
    ("resolve --debug foo seq -o out", USAGE, "--debug takes views: reject, count, motion, clip; see"),
    ("resolve seq more -o out", USAGE, "extra argument (more); see"),
    ("resolve seq more and -o out", USAGE, "extra arguments (more and); see"),
    ("resolve seq -o out --effects=", WRONG, "--effects names no effect; --effects none promises that nothing happens"),
    ("resolve seq -o out --effects all,camera", WRONG, "--effects: all stands alone (found all,camera); leave it out"),
    ("resolve seq -o out --effects camera,none", WRONG, "--effects: none stands alone (found camera,none); leave it"),
    ("resolve seq -o out --set box_leak=1 --set box_leak=0", WRONG, "--set box_leak is given twice; leave one of them"),
    ("check seq --input depth.scale=2 --input depth.scale=3", WRONG, "--input depth.scale is given twice; leave one"),
    (
        "bench quality --scene spinner --size 10x64",
        WRONG,
        "--size: too small to judge by SSIM (expected at least 11 pi",
    ),
    ("demo -o seq", WRONG, "seq: the folder holds frames; choose another one for the demo"),
    ("tune a b -o t.toml --budget 5ms --effects=", WRONG, "--effects names no effect"),
    ("resolve seq -o out --effects motoin", WRONG, "--effects: unknown effect motoin; did you mean motion?"),
    ("resolve seq -o out --storage x", USAGE, "Invalid value for '--storage'"),
    (
        "resolve seq -o a.mp4 --device numpy --preview a.mp4",
        WRONG,
        "overwrite the output; name another file or folder",
    ),
    ("resolve seq -o a.mp4/out --device numpy --preview a.mp4", WRONG, "a.mp4: the film would overwrite the output"),
    (
        "resolve seq -o out --config table.toml",
        WRONG,
        'table.toml: preset is the name of a preset, and no table (expected a text, such as "default"); write the keys',
    ),
    ("resolve seq -o out --config other.toml", WRONG, "other.toml: unknown preset nope"),
    ("resolve seq -o out --debug count --band-rows 4", WRONG, "images only; use --band-rows 0 or smaller frames"),
    ("resolve seq -o out --device numpy --compare side", WRONG, "--compare side needs a film; name it: --preview"),
    ("resolve seq -o out --device numpy --preview empty", OUTPUT, "empty: this is a folder"),
    (
        "resolve seq -o out --device numpy --preview x.gif",
        WRONG,
        "x.gif: a film must be an MP4 (expected .mp4 or .m4v,",
    ),
    ("resolve seq -o out --device numpy --preview no/x.mp4", OUTPUT, "no/x.mp4: the file cannot be created"),
    ("resolve seq -o out --profile nonsense", WRONG, "unknown profile nonsense"),
    (
        "resolve seq -o out --profile a.txt",
        WRONG,
        "a.txt; the name of a profile's file ends with .toml",
    ),
    ("profiles auto", WRONG, "unknown profile auto; known profiles: arnold, blender"),
    ("resolve seq -o out --profile blendr", WRONG, "unknown profile blendr; did you mean blender?"),
    ("resolve seq -o out --profile nowhere.toml", MISSING, "nowhere.toml: the file is missing"),
    ("resolve seq -o out --profile large.toml", DATA, "large.toml: too large for a profile"),
    ("resolve seq -o out --input nonsense", WRONG, "no value"),
    ("resolve seq -o out --input x.y=1", WRONG, "no such key"),
    ("resolve seq -o out --input colour.channels=x,y,z", DATA, "(found x); spaces separate the names of one: x y z"),
    ("resolve seq -o out --camera nowhere.json", MISSING, "nowhere.json: the file is missing"),
    ("resolve seq -o out --camera empty", DATA, "empty: this is a folder (expected a side file)"),
    ("resolve seq -o out --camera file.txt", DATA, "file.txt: line 1 is not understood"),
    ("resolve seq -o out --camera deep.json", DATA, "deep.json: not a side file"),
    ("resolve seq -o out --camera odd.txt", DATA, "odd.txt: line 1 is not understood"),
    ("check", USAGE, "Missing argument 'SEQUENCE'"),
    ("check nowhere", MISSING, "nowhere"),
    ("check seq --frames 0", USAGE, "not in the range"),
    ("check seq --frames 1-", USAGE, "'1-' is no range of frames, such as 8-47 or 12"),
    ("check seq --frames 1-9", WRONG, "frame 9: no such frame (expected 0-2)"),
    ("check seq --fix shot", WRONG, "--fix writes a profile (expected FILE.toml, found shot)"),
    ("check seq --fix empty", OUTPUT, "empty: this is a folder"),
    ("profiles nonsense", WRONG, "nonsense"),
    ("compare nowhere", MISSING, "nowhere: the folder is missing"),
    ("compare seq nowhere", MISSING, "nowhere: the folder is missing"),
    ("compare file.txt", DATA, "file.txt: this is not an EXR file"),
    ("compare seq small", DATA, "size differs from seq (expected 37 x 23, found 20 x 10)"),
    ("compare seq/synthetic.0000.exr small/synthetic.0001.exr", DATA, "size differs from seq/synthetic.0000.exr (expe"),
    ("compare small", WRONG, "nothing to compare with"),
    ("compare seq --camera nowhere.json", MISSING, "nowhere.json: the file is missing"),
    ("compare --table seq --camera nowhere.json", MISSING, "nowhere.json: the file is missing"),
    ("compare --table seq one --camera x.json", WRONG, "x.json: --camera is of one sequence"),
    ("compare seq small --camera x.json", WRONG, "small: --camera is of a capture; leave it out, or name a capture"),
    ("compare seq --metrics nonsense", WRONG, "unknown metric"),
    ("compare seq --metrics pnsr", WRONG, "unknown metric pnsr; did you mean psnr?"),
    ("compare seq --metrics Flip", WRONG, "unknown metric Flip; did you mean flip?"),
    ("compare seq --metrics lpips", WRONG, "unknown metric lpips; known metrics: "),
    ("compare seq --ours fast", WRONG, "--ours goes with --table; add --table"),
    ("compare seq --metrics ''", WRONG, "no metric is named"),
    ("compare seq --frames x", USAGE, "is no range of frames, such as 8-47"),
    ("compare seq --frames 0-99999999999999999999", WRONG, "no such frame"),
    ("compare seq --stops nan", USAGE, "not a number"),
    ("compare seq --stops 1e9", USAGE, "not in the range"),
    ("compare seq --heatmap seq", WRONG, "seq: --heatmap: maps have the names of the pictures there; name another"),
    ("compare seq --heatmap seq/reference", WRONG, "--heatmap: maps have the names of the pictures there"),
    ("compare seq --heatmap seq/reference-8", WRONG, "--heatmap: maps there would be taken for a truth"),
    ("compare seq --heatmap file.txt", OUTPUT, "file.txt: the folder cannot be created"),
    ("presets nonsense", WRONG, "unknown preset nonsense"),
    ("presets Babylon", WRONG, "unknown preset Babylon; did you mean one of babylon-accumulate, babylon-disable-on-c"),
    ("presets ''", WRONG, "known presets: accumulate, "),
    (
        "resolve seq -o out --set scale=2",
        WRONG,
        "--set: unknown key scale; did you mean one of box_scale_moving, box_scale_s",
    ),
    ("kernels --show nonsense", WRONG, "unknown kernel nonsense"),
    ("kernels --show resolv", WRONG, "unknown kernel resolv; did you mean resolve?"),
    ("kernels --show ../../etc/passwd", WRONG, "unknown kernel"),
    ("kernels --lanes 3", USAGE, "'3' is not one of"),
    ("scenes nonsense", USAGE, "unexpected extra argument"),
    ("doctor nonsense", USAGE, "unexpected extra argument"),
    ("bench nonsense", USAGE, "No such command"),
    ("bench quality --scene", USAGE, "requires an argument; see cltaa bench quality --help"),
    ("bench quality --scene spiner --work out", WRONG, "unknown scene spiner; did you mean spinner?"),
    ("bench quality --sequence seq --sequence small --work out --settled 1", MISSING, "small/reference: no truth"),
    ("bench quality --sequence seq --work out", DATA, "is judged (expected more than 8 frames, found 3); capture more"),
    ("bench quality --sequence seq --sequence twin/seq --work out --settled 1", WRONG, "two sequences of one name"),
    ("bench accuracy seq -o out --jobs 2 --dask tcp://a:1", WRONG, "--jobs and --dask both say who measures errors"),
    ("bench accuracy seq twin/seq -o out --only reject", WRONG, "twin/seq: two sequences of one name"),
    ("bench accuracy seq small -o out --only preset", MISSING, "small/reference: no truth"),
    ("tune seq small --budget 5ms -o out.toml", MISSING, "small/reference: no truth"),
    ("bench accuracy one -o out --only storage", DATA, "one: nothing to time (expected 2 frames or more, found 1)"),
    ("tune one --budget 5ms -o out.toml --device numpy", DATA, "one: nothing to time"),
    (
        "bench accuracy seq -o out --only ''",
        WRONG,
        "--only names nothing (expected variants or groups of them); leave it out for all",
    ),
    ("bench accuracy seq -o out --only colour", WRONG, "--only: unknown variant or group colour"),
    ("bench kernels --size x", USAGE, "'x' is not WIDTHxHEIGHT, such as 640x360"),
    ("bench quality --held-out 0,2", WRONG, "seed 0 was either tuned on or not; leave it out of --train or"),
    ("bench quality --train , --held-out ,", WRONG, "no seed to capture with; name one by --train"),
    ("bench quality --frames 8", WRONG, "would end before they are judged (found 8 frames); ask for more --frames"),
    ("bench quality --scene file:a/x.obj --scene file:b/x.obj", WRONG, "b/x.obj: two models of one name"),
    ("bench quality --sequence seq --size 64x36", WRONG, "--size is of captures; name their --scene too, or leave"),
    (
        "bench quality --sequence seq --config karis",
        WRONG,
        "karis: this is the name of a preset, and tables go by it; rename the file",
    ),
    ("bench quality --held-out 1,x", USAGE, "'1,x' is no list of whole numbers from 0 on"),
    ("capture spinner -o out --yardstick 2,1", USAGE, "from 2 on"),
    ("bench accuracy done -o out", WRONG, "done: these are results of cltaa resolve (found preset default)"),
    ("bench files seq --compression b44", WRONG, "unknown or lossy compression"),
    ("bench quality --sequence seq --work out --page nowhere/a.md", OUTPUT, "nowhere/a.md"),
    ("bench quality --sequence seq --work out --page file.txt", DATA, "file.txt: the marks are missing"),
    ("tune seq --check done --budget 5ms -o out.toml", WRONG, "done: these are results of cltaa resolve"),
    ("capture spiner -o out", WRONG, "no such scene: spiner; did you mean spinner? (see cltaa scenes)"),
    ("capture spinner -o out --jitter grid:5", WRONG, "use grid:9"),
    ("capture spinner -o out --yardstick 2,65537", WRONG, "too many samples a pixel (expected at most 65536, "),
    ("capture spinner -o out --motion orbit", WRONG, "--motion orbit applies to file:PATH"),
    ("capture spinner -o out --frames 0", USAGE, "0 is not in the range"),
    ("capture file:scene.blend -o out", WRONG, "no reader for .blend (expected .glb"),
    ("capture file:broken.glb -o out", DATA, "broken.glb: is no glTF 2.0 file"),
    ("capture '' -o out", WRONG, "no such scene"),
    ("capture spinner", USAGE, "Missing option '-o' / '--output'"),
    ("capture spinner -o file.txt", OUTPUT, "file.txt: the folder cannot be created"),
    ("capture spinner -o out --size 0x0", USAGE, "not WIDTHxHEIGHT"),
    ("capture spinner -o out --size 99999x99999", WRONG, "the frames are too large"),
    ("capture spinner -o out --jitter nonsense", WRONG, "no such jitter"),
    ("capture spinner -o out --jitter halton:99999999999", WRONG, "N from 1 to 65536"),
    ("raycast fog -o out --period 1000000000", USAGE, "1<=x<=65536"),
    ("capture spinner -o out --fps nan", WRONG, "fps must be 1e-06 to 1e+06"),
    ("capture spinner -o out --fps 0", USAGE, "not in the range"),
    ("capture file: -o out", WRONG, "no reader for a file without suffix"),
    ("capture file:nowhere.glb -o out", MISSING, "there is no such model; check the path behind file:"),
    ("capture file:/dev/zero -o out", WRONG, "no reader"),
    ("resolve seq -o out --set box_scale_static", WRONG, "--set box_scale_static: no value"),
    ("resolve seq -o out --device numpy --compression dwaa", WRONG, "unknown or lossy compression"),
    ("presets --against basic", WRONG, "--against compares with a preset"),
    ("compare done twin/seq seq --heatmap maps", WRONG, "--heatmap: maps of several would have one name"),
    ("bench kernels --size 4x4", WRONG, "too small to compare images in"),
    ("bench kernels --rounds 1", USAGE, "x>=3"),
    ("bench kernels --device numpy", WRONG, "bench kernels times OpenCL kernels"),
    ("tune seq -o out.toml", WRONG, "one of --budget and --target is needed"),
    ("tune seq -o out.toml --budget 5ms --trials 1", USAGE, "x>=2"),
    ("tune seq -o out.toml --budget 5ms --seed 4294967296", USAGE, "0<=x<=4294967295"),
    ("tune seq -o out.toml --target flip", WRONG, "no goal (expected --budget 5ms, or --target flip=0.02"),
    (
        "tune seq -o out.toml --target flip=0.1 --metric mse",
        WRONG,
        "--metric mse is of a --budget; leave it out: a --target names its own",
    ),
    ("tune seq -o out.toml --budget 5ms --metric psnr", WRONG, "no metric to minimise"),
    ("capture spinner -o out --motion play", WRONG, "not to scene spinner; leave it out"),
    ("demo -o file.txt", OUTPUT, "the folder cannot be created"),
    ("demo -o out --scene nonsense", WRONG, "no such scene: nonsense"),
    ("demo -o out --size 3x90", WRONG, "--size: too small (expected at least 4 pixels a side"),
    ("demo -o out --device nonsense", WRONG, "no OpenCL device matches nonsense"),
]


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    write_sequence(folder / "seq", 3, reference=True)
    write_sequence(folder / "small", 3, width=20, height=10)
    write_sequence(folder / "one", 1, reference=True)
    assert main(["resolve", str(folder / "seq"), "-o", str(folder / "done"), "--device", "numpy"]) == 0
    write_sequence(folder / "twin" / "seq", 3, reference=True)
    for name in ("empty", "noexr", "pngs", "linked"):
        (folder / name).mkdir()
    (folder / "noexr" / "readme").touch()
    (folder / "pngs" / "a.0001.PNG").touch()
    (folder / "loop").symlink_to("loop")
    for path in (folder / "seq").glob("*.exr"):
        (folder / "linked" / path.name).symlink_to(path)
    (folder / "file.txt").write_text("not what you think")
    (folder / "latin.toml").write_bytes(b"# caf\xe9")
    (folder / "table.toml").write_text("[preset]\nhistory_frames = 3\n")
    (folder / "other.toml").write_text('preset = "nope"')
    (folder / "broken.glb").write_bytes(b"glTF\0\0\0 not really")
    (folder / "said.toml").write_text("published = 3")
    (folder / "profile.toml").write_text("[colour]\n[jitter]\n")
    (folder / "jitter.toml").write_text("[jitter]\nscale = [-1.0, -1.0]\n")
    (folder / "large.toml").write_text("#" * 100_000)
    (folder / "deep.toml").write_text("x = " + "[" * 60_000)
    (folder / "deep.json").write_text('{"frames": ' + "[" * 100_000)
    (folder / "odd.txt").write_text("frame \N{SUPERSCRIPT TWO}\n")
    return folder


@pytest.mark.parametrize("command", sorted({line.split()[0] for line, _, _ in CASES}))
def test_a_meaningless_command_prints_one_line_and_returns_its_code(
    desk: Path, command: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(desk)
    for line, code, words in CASES:
        if line.split()[0] == command:
            assert main(shlex.split(line)) == code, line
            said = capfd.readouterr()
            assert said.out == "", line
            assert said.err.startswith("cltaa: error: "), line
            assert said.err.count("\n") == 1, line
            assert words in said.err, line


LISTS = ("profiles", "profiles blender", "presets", "presets fast", "presets --parameters", "scenes", "kernels")


def test_lists_are_json_when_asked(capsys: pytest.CaptureFixture[str]) -> None:
    for line in LISTS:
        assert main([*line.split(), "--json"]) == 0, line
        said = capsys.readouterr()
        assert said.out == json_of(json.loads(said.out)) + "\n", line  # the same form everywhere
        assert said.err == "", line


def test_answers_are_json_when_asked(
    desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(desk)
    resolve, plan = "resolve seq -o told --device numpy", "inspect seq --plan --device numpy --preset accumulate"
    for line in ("inspect seq", plan, "check seq", resolve, "compare told seq"):
        main([*line.split(), "--json"])  # random numbers are no good sequence, and check and inspect say so
        said = capsys.readouterr()
        assert said.out == json_of(json.loads(said.out)) + "\n"


# The signal comes from within, when the sixth of eight frames is read: from outside it might come behind the last one.
INTERRUPTED = """
import os, signal, sys
from cltaa.io import exr_read
from cltaa.cli import main

loaded_parts = exr_read.loaded_parts


def interrupted(path, *given, **named):
    if path.parts[-2:] == ("seq", "synthetic.0005.exr"):
        os.kill(os.getpid(), signal.SIGINT)
    return loaded_parts(path, *given, **named)


exr_read.loaded_parts = interrupted
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("command", ["inspect --pixels seq", "compare --metrics flip seq"])
def test_an_interrupt_prints_one_line_and_exits_with_130(tmp_path: Path, command: str) -> None:
    """Ctrl-C in the midst of the work: one line more, and 130."""
    write_sequence(tmp_path / "seq", 8, reference=True, width=320, height=180)
    child = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, *command.split()], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (child.returncode, child.stdout) == (130, "")
    assert child.stderr.splitlines()[-1] == "cltaa: interrupted"
    assert "Traceback" not in child.stderr
