"""Run notebooks and keep the outputs that a reader needs; `make notebooks` calls it."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

LONGEST_SECONDS = 1200
"""After which a cell is given up."""

METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def executed(path: Path) -> str:
    """Return the text of a notebook after a run in an empty folder.

    Progress, times and the plain form of figures and tables are left out: the last has paths.
    Raise nbclient.exceptions.CellExecutionError if a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(
            notebook, timeout=LONGEST_SECONDS, resources={"metadata": {"path": folder}}
        ).execute()
    notebook.metadata = METADATA
    for cell in notebook.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = [one for one in cell.outputs if not _is_progress(one)]
            for output in cell.outputs:
                if len(output.get("data", {})) > 1:
                    del output.data["text/plain"]
    return str(nbformat.writes(notebook)) + "\n"


def _is_progress(output: NotebookNode) -> bool:
    """Whether an output is a message or a bar of a long call."""
    bar = output.get("data", {}).get("text/html", "").startswith("<progress")
    return bar or output.get("name") == "stderr"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        file = Path(name)
        file.write_text(executed(file), encoding="utf-8")
        print(file)
