"""The entry point of ``cltaa`` and ``python -m cltaa``; handles an interrupt during the import as well."""

import os
import sys


def main() -> int:
    """Run the command line and return its exit code."""
    try:
        from cltaa.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("cltaa: interrupted\n")
        sys.stderr.flush()
        # The value of cltaa.cli.INTERRUPTED, which may not be imported yet. os._exit, because Python ends by the signal
        # if the interrupt passed through an ``exec``.
        os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
