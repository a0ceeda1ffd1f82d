"""The command line: ``cltaa SUBCOMMAND``; each subcommand is imported only when it is called."""

from __future__ import annotations

import atexit
import importlib
import io
import os
import sys
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from cltaa import __version__
from cltaa.errors import CltaaError, InternalError, ResourceError, UsageError, refused
from cltaa.printable import printable
from cltaa.process import Stop, configure, ends_at_once, ignore_signals, interrupts
from cltaa.renamed import one_line_each


class Entry(NamedTuple):
    """The module of a subcommand and the line that ``--help`` prints about it."""

    module: str
    command: str
    summary: str


class LazyGroup(click.Group):
    """A click group over a table of entries: listing and completing them imports none of them."""

    def __init__(self, *arguments: Any, entries: Mapping[str, Entry], **others: Any) -> None:
        super().__init__(*arguments, **others)
        self.entries = entries

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return every name, sorted."""
        return sorted(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one subcommand, or None for an unknown name."""
        if cmd_name not in self.entries:
            return None
        entry = self.entries[cmd_name]
        command: click.Command = getattr(importlib.import_module(entry.module), entry.command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve as click does, but suggest for a misspelt name from all entries, not only from imported ones."""
        try:
            return super().resolve_command(ctx, args)
        except click.NoSuchCommand as error:
            raise click.NoSuchCommand(error.command_name, possibilities=self.entries, ctx=ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.entries[name].summary) for name in self.list_commands(ctx)])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete subcommands without importing them, then options."""
        names = [CompletionItem(n, help=e.summary) for n, e in sorted(self.entries.items()) if n.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)


# Each module is imported only when its command runs: ``cltaa resolve`` needs no OpenGL, ``cltaa capture`` no OpenCL,
# and ``cltaa --help`` neither.
COMMANDS = {
    "bench": Entry("cltaa.cli", "bench", "Measure time, and what accuracy costs in it."),
    "capture": Entry("cltaa_capture.cli", "capture", "Draw a scene as a jittered EXR sequence, and its reference."),
    "check": Entry("cltaa.commands.check", "check", "Find wrong conventions in a sequence, from its pixels."),
    "compare": Entry("cltaa.commands.compare", "compare", "Measure the error of one sequence against another."),
    "demo": Entry("cltaa.commands.demo", "demo", "Capture a scene, resolve it and show what was gained."),
    "doctor": Entry("cltaa.commands.doctor", "doctor", "Look for what capture and resolve need on this machine."),
    "inspect": Entry("cltaa.commands.inspect", "inspect", "Say what is in a sequence."),
    "kernels": Entry("cltaa.commands.presets", "kernels", "List the OpenCL kernels, or print one as it is built."),
    "presets": Entry("cltaa.commands.presets", "presets", "List the presets and what each sets."),
    "profiles": Entry("cltaa.commands.presets", "profiles", "List the reader profiles for files of other tools."),
    "raycast": Entry("cltaa_datasets.ray_cast", "raycast", "Ray-cast a scene that declares no effects."),
    "resolve": Entry("cltaa.commands.resolve", "resolve", "Anti-alias a sequence over time."),
    "scenes": Entry("cltaa_datasets.cli", "scenes", "List the scenes that capture can draw."),
    "tune": Entry("cltaa.commands.tune", "command", "Search for the best settings within a time or an error."),
}

MEASUREMENTS = {
    "accuracy": Entry("cltaa.commands.bench_accuracy", "accuracy", "Measure what each step of accuracy costs in time."),
    "api": Entry("cltaa.commands.bench_times", "api", "Time a call from a program against its kernels and the bus."),
    "devices": Entry("cltaa.commands.bench_times", "devices", "Measure how kernels are best cut up for a device."),
    "files": Entry("cltaa.commands.bench_times", "files", "Time files, and how well the stages of a resolve overlap."),
    "kernels": Entry("cltaa.commands.bench_times", "kernels", "Time the kernels against the alternatives."),
    "quality": Entry("cltaa.commands.bench_quality", "quality", "Judge presets on scenes against the truth."),
}

COMPLETION, SHELLS = "_CLTAA_COMPLETE", ("bash", "fish", "zsh")
INTERRUPTED, CLOSED_PIPE = 130, 141  # the shells' convention: 128 plus the number of SIGINT, of SIGPIPE

# The commands that resume from what they had finished.
GOES_ON = {("capture",), ("demo",), ("raycast",), ("resolve",), ("bench", "accuracy"), ("bench", "quality"), ("tune",)}


@click.group(
    cls=LazyGroup,
    entries=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110, "show_default": True},
)
@click.version_option(__version__)
@click.option("--debug", is_flag=True, help="Show the whole traceback of an error.")
@click.pass_context
def root(ctx: click.Context, debug: bool) -> None:
    """Capture, resolve and judge temporal anti-aliasing."""
    ctx.obj = {"debug": debug}


@click.group(cls=LazyGroup, entries=MEASUREMENTS)
def bench() -> None:
    """Measure time, and what accuracy costs in it."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code (sysexits; 130 when interrupted); an error prints one line.

    Without ``arguments`` it reads those of the process, which then has nothing left to do but to end.
    """
    if arguments is not None:
        return _outcome(arguments)
    atexit.register(ignore_signals)  # runs after Python has waited for the threads
    ends_at_once(INTERRUPTED)  # for signals outside of _outcome's own handling
    _open_standard_streams()
    unread = io.BufferedWriter(_LossyFile(2, "w", closefd=False))
    sys.stderr = io.TextIOWrapper(unread, sys.stderr.encoding, line_buffering=True)
    try:
        code = _outcome(sys.argv[1:])
    except KeyboardInterrupt:  # a second one, while the first was reported
        code = INTERRUPTED
    ends_at_once(code)
    if code == INTERRUPTED:
        # Python up to 3.12 considers a thread ended when the wait for it was interrupted, and lets it run during the
        # interpreter's shutdown, where OpenEXR then aborts. Files are atomic: none is half-written.
        os._exit(code)
    return code


def _outcome(arguments: list[str]) -> int:
    _open_standard_streams()
    if os.environ.get("COLUMNS") == "0":  # unknown width, for which tables would have no columns
        del os.environ["COLUMNS"]
    configure()
    debug, arguments = _take_debug(arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a character that the terminal cannot encode raises nothing
    stop = Stop()
    try:
        with one_line_each(), interrupts(stop):
            _check_completion()
            outcome: Any = root.main(arguments, prog_name="cltaa", standalone_mode=False)
        sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort):
        return _interrupted(arguments)
    except click.exceptions.NoArgsIsHelpError as error:
        return _told(error.format_message(), error.exit_code)
    except (SystemExit, BrokenPipeError) as error:  # click turns the one into the other, of code 1
        if isinstance(error, SystemExit) and error.code != 1:  # the end of completion, or a library's
            raise
        if stop.requested:
            return _interrupted(arguments)
        _discard_output()  # the reader of our output closed the pipe
        return CLOSED_PIPE
    except Exception as error:
        if stop.requested and not isinstance(error, CltaaError):  # caused by the interrupt; our own errors are reported
            return _interrupted(arguments)
        if debug and not isinstance(error, click.ClickException):
            raise
        return _failed(error, arguments)
    if stop.requested:  # the command did not notice, and has printed its output
        return _interrupted(arguments, answered=True)
    return outcome if isinstance(outcome, int) else 0


def _check_completion() -> None:
    """Raise UsageError where the variable for completion asks for none: click would end without a line."""
    asked, words = os.environ.get(COMPLETION, ""), os.environ.keys() & {"COMP_WORDS", "COMP_CWORD"}
    shell, _, what = asked.partition("_")
    place = shell == "fish" or os.environ.get("COMP_CWORD", "").isdigit()  # fish has the word itself there
    if asked and (shell not in SHELLS or not (what == "source" or (what == "complete" and len(words) == 2 and place))):
        expected = ", ".join(f"{shell}_source" for shell in SHELLS)
        raise UsageError(f"{COMPLETION}={asked} asks for no completion", expected=expected)


class _LossyFile(io.FileIO):
    """A standard error that drops what it cannot write: no work ends because nobody reads its progress any more."""

    def write(self, content: Any, /) -> int:
        """Write, or drop, bytes; returns how many."""
        try:
            written: int | None = super().write(content)  # None where a pipe that does not block is full
        except OSError:
            written = None
        return memoryview(content).nbytes if written is None else written


def _open_standard_streams() -> None:
    """Redirect a closed standard stream, as a service may have, to the null device.

    Otherwise the next opened file would take its number, and a driver's output would go into an EXR.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes the least free number: this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def _take_debug(arguments: list[str]) -> tuple[bool, list[str]]:
    """Move --debug, which belongs to the root, to the front from anywhere; after ``--`` it is a name.

    Before a list of views it is the option of ``cltaa resolve``.
    """
    if "--debug" not in arguments:
        return False, arguments
    from cltaa.core.debug import are_views  # imported here, because it needs NumPy

    end = arguments.index("--") if "--" in arguments else len(arguments)
    following = [*arguments[1:], ""]
    pairs = zip(arguments[:end], following, strict=False)
    others = [argument for argument, after in pairs if argument != "--debug" or are_views(after)]
    debug = len(others) < end
    return debug, ["--debug"] * debug + others + arguments[end:]


def _told(line: str, code: int, arguments: Sequence[str] = (), *, already: bool = False) -> int:
    """Print a last line on standard error, if it does not stand there ``already``; returns ``code``.

    With ``--json`` a document on standard output holds it too. On a full disk or a closed pipe only the code reports.
    """
    if not already:
        click.echo(line, err=True)
    if "--json" in takewhile(lambda word: word != "--", arguments):
        import json  # imported here: it is slow, and most runs do not fail

        try:
            click.echo(json.dumps({"error": line.removeprefix("cltaa: ").removeprefix("error: "), "exit_code": code}))
        except OSError:
            _discard_output()
    return code


def _discard_output() -> None:
    """Send what standard output still buffers to the null device: Python would flush it at exit, and fail with its own
    code."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupted(arguments: list[str], *, answered: bool = False) -> int:
    words = [argument for argument in arguments if not argument.startswith("-")]
    goes_on = tuple(words[:1]) in GOES_ON or tuple(words[:2]) in GOES_ON
    more = "; what was finished is kept, run the same again to go on" if goes_on else ""
    return _told(f"cltaa: interrupted{more}", INTERRUPTED, () if answered else arguments)


def _failed(error: Exception, arguments: Sequence[str]) -> int:
    if isinstance(error, click.ClickException):
        context = getattr(error, "ctx", None)
        words = [*takewhile(lambda word: not word.startswith("-"), arguments)]
        parsed = ["cltaa", *words[: 2 if words[:1] == ["bench"] else 1]]  # what the parser of options does not tell
        command = " ".join(parsed) if context is None else context.command_path
        line = " ".join(error.format_message().split()).rstrip(".")
        return _told(f"cltaa: error: {printable(line)}; see {command} --help", error.exit_code, arguments)
    deliberate = _deliberate(error)
    return _told(f"cltaa: error: {deliberate}", deliberate.exit_code, arguments, already=deliberate.told)


def _deliberate(error: Exception) -> CltaaError:
    """Return the CltaaError that reports an unexpected exception to a user."""
    match error:
        case CltaaError():
            return error
        # A missing module of cltaa's own is a bug, not an extra that is not installed.
        case ModuleNotFoundError() if error.name is not None and not error.name.startswith("cltaa"):
            missing = f"the Python package {error.name} is not installed"
            return UsageError(missing, cure="run: pip install 'cltaa[all]'")
        case MemoryError():
            return ResourceError("memory ran out", cure="use smaller frames or a machine with more memory")
        case OSError():
            return refused(error)
        case _:
            cure = "this is a fault of cltaa: run it again with --debug and report what it shows"
            return InternalError(f"{type(error).__name__}: {error}", cure=cure)


if __name__ == "__main__":
    sys.exit(main())
