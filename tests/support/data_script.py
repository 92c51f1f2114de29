"""Scripts beside the data that they have made."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def data_script(path: Path) -> ModuleType:
    """Load a script as a module; dataclasses look their module up by name."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module
