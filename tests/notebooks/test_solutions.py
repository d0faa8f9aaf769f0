"""Every folded solution is one: what it says to run is run, and the model says solved."""

import ast
import json
import re
from pathlib import Path

import pytest

from labkit.experiment import Feedback

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
CHECKED = (
    "00_start_here.ipynb",
    "01_priority_inversion.ipynb",
    "02_cache_speedups.ipynb",
    "03_dma_coherence.ipynb",
    "04_trace_sink.ipynb",
    "05_tick_rates.ipynb",
    "06_micro_ros_vs_freertos.ipynb",
    "07_schedulability.ipynb",
    "08_taft_phases.ipynb",
    "11_laser_pipeline.ipynb",
    "13_distributed_fusion.ipynb",
)


def exercises(name):
    """The code of each exercise and the text of its solution; and what the notebook imports, as code."""
    cells = json.loads((NOTEBOOKS / name).read_text(encoding="utf-8"))["cells"]
    sources = [(cell["cell_type"], "".join(cell["source"])) for cell in cells]
    folded = [i for i, (_, text) in enumerate(sources) if "<summary>Solution</summary>" in text]
    assert all(sources[i - 1][0] == "code" for i in folded), "a solution stands behind its exercise"
    imports = [line for kind, text in sources if kind == "code" for line in text.splitlines() if line.startswith("from labkit")]
    return [(sources[i - 1][1], sources[i][1].partition("</details>")[0]) for i in folded], "\n".join(imports)


def value(code, names):
    """What the last line of the code is worth, as in a cell."""
    *before, last = ast.parse(code).body
    exec(compile(ast.Module(before, []), "cell", "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    return exec(compile(ast.Module([last], []), "cell", "exec"), names)


@pytest.mark.parametrize("name", CHECKED)
def test_solutions_solve(name):
    found, imports = exercises(name)
    assert len(found) >= 2
    for number, (exercise, solution) in enumerate(found, 1):
        names: dict = {}
        exec(imports, names)
        given = value(exercise, names)
        assert isinstance(given, Feedback) and not given.solved, f"exercise {number} as it is given: {given}"
        blocks = re.findall(r"```python\n(.*?)```", solution, flags=re.DOTALL)
        runs = [block if "check_" in block else block + exercise.splitlines()[-1] for block in blocks]
        prose = re.sub(r"```.*?```", "", solution, flags=re.DOTALL)
        runs += [code for code in re.findall(r"`([^`]*)`", prose) if "check_" in code or re.match(r"\w+ = ", code)]
        answers = [answer for code in runs if isinstance(answer := value(code, names), Feedback)]
        assert answers and all(answer.solved for answer in answers), f"solution {number}: {answers}"
