"""The C in the notebooks compiles, against stub headers, and says the same as the Python model beside it."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
HEADERS = [Path(__file__).parent / name for name in ("freertos", "cmsis")]
STRICT = ("-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c", "-")
GCC = shutil.which("gcc")


def cells(path, kind):
    found = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def blocks(path):
    """The C of a notebook, block by block."""
    return [block for text in cells(path, "markdown") for block in re.findall(r"```c\n(.*?)```", text, flags=re.DOTALL)]


def compiled(code):
    """What gcc complains about; '' if nothing."""
    return subprocess.run(
        [GCC, *(f"-I{folder}" for folder in HEADERS), *STRICT], input=code, capture_output=True, text=True, timeout=60
    ).stderr


WITH_C = [path for path in sorted(NOTEBOOKS.glob("*.ipynb")) if blocks(path)]


def test_there_is_c_to_compile():
    assert "01_priority_inversion" in [path.stem for path in WITH_C]


@pytest.mark.skipif(GCC is None, reason="no gcc here")
@pytest.mark.parametrize("path", WITH_C, ids=lambda path: path.stem)
def test_the_c_of_the_notebooks_compiles(path):
    for code in blocks(path):
        assert compiled(code) == ""
        assert "undeclared" in compiled(code.replace("{", "{ no_such_name(); no_such_variable;", 1)), "it would not notice"


@pytest.mark.parametrize("path", WITH_C, ids=lambda path: path.stem)
def test_tasks_have_the_same_names_and_priorities_in_both(path):
    model = "\n".join(cells(path, "code"))
    for code in blocks(path):
        made = re.findall(r'xTaskCreate\((\w+), "(\w+)", .*?, (\d+), \w+\);', code)
        for body, name, priority in made:
            assert re.search(rf"^def {body}\(os\):", model, flags=re.MULTILINE), f"no body {body} in the model"
            assert re.search(rf'k\.task\("{name}", {body}, priority={priority}\)', model), (
                f"no task {name} like this in the model"
            )
        assert sorted(body for body, *_ in made) == sorted(re.findall(r"^static void (\w+)\(void \*", code, flags=re.MULTILINE))
