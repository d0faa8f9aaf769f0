"""Run the notebooks and store what nbval compares: the text of cells marked `# NBVAL_CHECK_OUTPUT`, and nothing else.

Called by `make notebooks`; look at the difference before committing it.
"""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbval.plugin import coalesce_streams

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


def store(path: Path) -> None:
    """Run one notebook in its folder and rewrite it in the committed form; raises CellExecutionError where a cell fails."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(path.parent)}}).execute()
    notebook.metadata = {"kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}}
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # time stamps
        if cell.cell_type == "code":
            compared = "NBVAL_CHECK_OUTPUT" in cell.source
            cell.outputs = [plain(output) for output in coalesce_streams(cell.outputs)] if compared else []
            cell.execution_count = 1 if compared else None
    nbformat.write(notebook, path)


def plain(output: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The output as text, without the number of its run."""
    if "data" in output:
        output.data = {"text/plain": output.data["text/plain"]}
        output.metadata = {}
    if "execution_count" in output:
        output.execution_count = 1
    return output


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:] or sorted(NOTEBOOKS.glob("*.ipynb"))):
        store(path)
        print(f"stored {path.name}")
