"""The command line: ``cltaa SUBCOMMAND``; each subcommand is imported only when it is called."""

from __future__ import annotations

import sys
from typing import Any

import click

from cltaa.errors import CltaaError, UsageError
from cltaa.lazy import Entry, LazyGroup

# A module is imported when its command runs, and not to list it: ``cltaa resolve`` needs no OpenGL, ``cltaa capture``
# no OpenCL, and ``cltaa --help`` neither.
COMMANDS = {
    "bench": Entry("cltaa.commands.bench", "bench", "Measure time, and what accuracy costs in it."),
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


@click.group(
    cls=LazyGroup,
    entries=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
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
