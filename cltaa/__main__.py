"""``python -m cltaa``: the command line, for a Python whose scripts are not on the path."""

import sys

from cltaa.cli import main

sys.exit(main())
