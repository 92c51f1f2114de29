"""`python -m pyburgers`: the command line where its script is not on the path."""

import sys

from pyburgers.cli.main import main

sys.exit(main())
