"""That nbval, as the lab calls it, can fail: each kind of fault a notebook can have is provoked once."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
OPTIONS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
INTERACTIVE_OUTPUT = "import ipywidgets as w\nn = w.IntSlider()\nw.interactive_output(lambda n: 1 // n, dict(n=n))"

#: Name -> expected outcome, the cell, what the notebook has stored for it (None: never run).
CELLS = {
    "sound": ("passed", "# NBVAL_CHECK_OUTPUT\nprint(6 * 7)", "42\n"),
    "wrong number": ("failed", "# NBVAL_CHECK_OUTPUT\nprint(6 * 7)", "43\n"),
    "lost number": ("failed", "# NBVAL_CHECK_OUTPUT\nprint(6 * 7)", ""),
    "not compared": ("passed", "print(6 * 7)", "43\n"),
    "failed assertion": ("failed", "assert 6 * 7 == 43", None),
    "error inside interact": ("failed", "import ipywidgets as w\nw.interact(lambda n: 1 // n, n=w.IntSlider());", None),
    "error inside interactive_output": ("failed", INTERACTIVE_OUTPUT, None),
    "beside the notebook": ("passed", "import pathlib\nassert pathlib.Path('faults.ipynb').exists()", None),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, str]:
    """Name of the cell -> passed or failed, in a session of its own with the project's options."""
    folder = tmp_path_factory.mktemp("nbval")
    cells = []
    for _, source, stored in CELLS.values():
        outputs = [nbformat.v4.new_output("stream", name="stdout", text=stored)] if stored else []
        cells.append(nbformat.v4.new_code_cell(source, outputs=outputs, execution_count=None if stored is None else 1))
    nbformat.write(nbformat.v4.new_notebook(cells=cells), folder / "faults.ipynb")
    (folder / "pytest.ini").write_text(f"[pytest]\naddopts = {OPTIONS['addopts']}\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", "--tb=no", str(folder)]
    run = subprocess.run(command, cwd=folder.parent, capture_output=True, text=True)
    found = re.findall(r"::Cell (\d+) (PASSED|FAILED|ERROR)", run.stdout)
    return {list(CELLS)[int(number)]: word.lower() for number, word in found}


@pytest.mark.parametrize("name", CELLS)
def test_nbval_tells_sound_from_faulty(outcomes, name):
    assert outcomes.get(name) == CELLS[name][0]


def test_make_test_collects_every_notebook():
    assert "notebooks" in OPTIONS["testpaths"] and "--nbval-lax" in OPTIONS["addopts"].split()
