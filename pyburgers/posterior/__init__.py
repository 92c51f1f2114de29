"""From chain files to labelled draws."""

import sys

from pyburgers.common.errors import SystemFailureError

if sys.flags.optimize > 1:
    raise SystemFailureError(
        "Python leaves out docstrings (-OO or PYTHONOPTIMIZE=2), which ArviZ needs to check draws; "
        "expected at most -O: unset PYTHONOPTIMIZE, or set it to 1."
    )
