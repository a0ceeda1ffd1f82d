"""The command line: ``cltaa SUBCOMMAND``; each subcommand is imported only when it is called."""

from __future__ import annotations

import importlib
import sys
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from cltaa.errors import CltaaError, UsageError


class Entry(NamedTuple):
    """Where a subcommand lives and the line that ``cltaa --help`` says about it."""

    module: str
    command: str
    summary: str


# A module is imported when its command runs, and not to list it: ``cltaa resolve`` needs no OpenGL, ``cltaa capture``
# no OpenCL, and ``cltaa --help`` neither.
COMMANDS = {
    "capture": Entry("cltaa_capture.cli", "capture", "Draw a scene as a jittered EXR sequence, and its reference."),
    "compare": Entry("cltaa.commands.compare", "compare", "Measure the error of one sequence against another."),
    "demo": Entry("cltaa.commands.demo", "demo", "Capture a scene, resolve it and show what was gained."),
    "doctor": Entry("cltaa.commands.doctor", "doctor", "Look for what capture and resolve need on this machine."),
    "inspect": Entry("cltaa.commands.inspect", "inspect", "Say what is in a sequence."),
    "kernels": Entry("cltaa.commands.kernels", "kernels", "List the OpenCL kernels, or print one as it is built."),
    "presets": Entry("cltaa.commands.presets", "presets", "List the presets and what each sets."),
    "resolve": Entry("cltaa.commands.resolve", "resolve", "Anti-alias a sequence over time."),
    "scenes": Entry("cltaa_datasets.cli", "scenes", "List the scenes that capture can draw."),
}


class LazyGroup(click.Group):
    """A click group that imports a subcommand's module only when the subcommand is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return every name, sorted."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one subcommand, or None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        entry = COMMANDS[cmd_name]
        command: click.Command = getattr(importlib.import_module(entry.module), entry.command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].summary) for name in self.list_commands(ctx)])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete subcommands without importing them, then options."""
        names = [CompletionItem(n, help=e.summary) for n, e in sorted(COMMANDS.items()) if n.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="cltaa")
@click.option("--debug", is_flag=True, help="Show the whole traceback of an error.")
@click.pass_context
def root(ctx: click.Context, debug: bool) -> None:
    """Capture, resolve and judge temporal anti-aliasing."""
    ctx.obj = {"debug": debug}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code (sysexits; 130 when interrupted)."""
    arguments = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in arguments
    # --debug belongs to the root but is understood wherever it stands.
    arguments = ["--debug"] * debug + [argument for argument in arguments if argument != "--debug"]
    try:
        outcome: Any = root.main(arguments, prog_name="cltaa", standalone_mode=False)
    except CltaaError as error:
        if debug:
            raise
        return _failed(error)
    except ModuleNotFoundError as error:
        # A module of cltaa's own that is missing is a bug, not an extra that was left out.
        if debug or error.name is None or error.name.startswith("cltaa"):
            raise
        extra = f"the Python package {error.name} is not installed"
        return _failed(UsageError(extra, cure="run: pip install 'cltaa[all]'"))
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("cltaa: interrupted; the frames already written are complete, run the same again to go on", err=True)
        return 130
    return outcome if isinstance(outcome, int) else 0


def _failed(error: CltaaError) -> int:
    click.echo(f"cltaa: error: {error}", err=True)
    return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
