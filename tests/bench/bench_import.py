"""How long `import labkit` takes in a fresh interpreter (goal: 0.3 s before plotly is needed), beside numpy alone."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["numpy", "labkit", "labkit.scheduler", "labkit.experiments.priority_inversion"])
def test_import(benchmark, module):
    benchmark.pedantic(
        subprocess.run, args=([sys.executable, "-c", f"import {module}"],), kwargs={"check": True}, rounds=5, warmup_rounds=1
    )
