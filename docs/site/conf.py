"""How Sphinx builds the site (`make docs`)."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))

from directives import EXTRA  # noqa: E402 - that folder is not on the path before
from notebook_runs import LONGEST_SECONDS  # noqa: E402

project = "pyburgers"
author = "the authors of pyburgers"
version = release = version_of("pyburgers")
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_design",
    "directives",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
root_doc = "docs/index"
# The source is the whole repository, so that links work here as they do in the files themselves.
include_patterns = [
    "docs/**.md",
    "notebooks/*",
    "stan/README.md",
    "reports/README.md",
    "reports/calibration/**.md",
    "benchmarks/results/*.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = ["build", ".venv", "runs", "report", "docs/site"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3

# Notebooks run while the site is built, each in a folder of its own.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = LONGEST_SECONDS
nb_execution_raise_on_error = True
nb_output_stderr = "remove"
nb_merge_streams = True

autodoc_typehints = "none"  # the docstrings say them
autodoc_member_order = "bysource"
autosummary_generate = False
numpydoc_show_class_members = False

html_theme = "furo"
html_title = f"pyburgers {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}

# Pages of `report` and the explorer stand beside the site as they are.
EXTRA.mkdir(parents=True, exist_ok=True)
html_extra_path = [str(EXTRA), "beside"]
