"""The command line: ``cltaa SUBCOMMAND``; each subcommand is imported only when it is called."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import click

from cltaa.errors import CltaaError

# name -> (module, click command in it). A module is imported when its command runs, so that ``cltaa resolve`` needs no
# OpenGL and ``cltaa capture`` needs no OpenCL.
COMMANDS = {
    "capture": ("cltaa_capture.cli", "capture"),
    "compare": ("cltaa.commands.compare", "compare"),
    "demo": ("cltaa.commands.demo", "demo"),
    "doctor": ("cltaa.commands.doctor", "doctor"),
    "inspect": ("cltaa.commands.inspect", "inspect"),
    "kernels": ("cltaa.commands.kernels", "kernels"),
    "presets": ("cltaa.commands.presets", "presets"),
    "resolve": ("cltaa.commands.resolve", "resolve"),
    "scenes": ("cltaa_datasets.cli", "scenes"),
}


class LazyGroup(click.Group):
    """A click group that imports a subcommand's module only when the subcommand is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name]
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command


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
    try:
        outcome: Any = root.main(arguments, prog_name="cltaa", standalone_mode=False)
    except CltaaError as error:
        if "--debug" in arguments:
            raise
        click.echo(f"cltaa: error: {error}", err=True)
        return error.exit_code
    except click.UsageError as error:
        error.show()
        return error.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("cltaa: interrupted; the frames already written are complete, run the same command to go on", err=True)
        return 130
    return outcome if isinstance(outcome, int) else 0


if __name__ == "__main__":
    sys.exit(main())
