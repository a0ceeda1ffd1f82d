"""The command line, for the command ``cltaa`` and for ``python -m cltaa``; it may be interrupted as it is imported."""

import os
import sys


def main() -> int:
    """Run it and return its exit code."""
    try:
        from cltaa.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("cltaa: interrupted\n")
        sys.stderr.flush()
        # cltaa.cli.INTERRUPTED, which may not be there yet; and Python would end by the signal where it met ``exec``.
        os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
