"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments.

Long calls report progress to the logger ``pyburgers``, at level INFO.
"""

import ast
import copyreg
import logging
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

_MODULE_OF = {
    name.name: part.module
    for part in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(part, ast.ImportFrom)
    for name in part.names
}
"""Modules of the public names, which stand in __init__.pyi; a name is imported when asked for."""

__all__ = sorted(_MODULE_OF)

logging.getLogger(__name__).addHandler(logging.NullHandler())


def _read_only(content: dict[object, object]) -> MappingProxyType[object, object]:
    return MappingProxyType(content)


# Tests, priors and fits hold mappings that nobody can change, of which Python makes no copies.
copyreg.pickle(MappingProxyType, lambda found: (_read_only, (dict(found),)))


def __getattr__(name: str) -> object:
    """Import a public name, or look up the version."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return globals()[name]


def __dir__() -> list[str]:
    """Return the public names, imported or not, and those of modules."""
    return sorted({*globals(), *__all__, "__version__"})
