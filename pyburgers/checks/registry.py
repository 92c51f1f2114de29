"""The checks of a fit of curves: all that the modules of this folder have, the sampling first."""

import pkgutil
from importlib import import_module

from pyburgers import checks
from pyburgers.checks.fit_checks import Check, CheckKind

CHECKS: tuple[Check, ...] = tuple(
    sorted(
        {
            found: None
            for module in pkgutil.iter_modules(checks.__path__, f"{checks.__name__}.")
            if module.name != __name__
            for found in vars(import_module(module.name)).values()
            if isinstance(found, Check)
        },
        key=lambda found: list(CheckKind).index(found.kind),
    )
)
"""Console, page and exit code follow: a check is told as soon as it is in the folder."""
