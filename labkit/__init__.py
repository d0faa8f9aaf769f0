"""labkit: the models of the Real-Time Lab. Everything heavy is imported when first used.

`from labkit import explore, PriorityInversion` is all a notebook needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "explore": "labkit.explore", "predict": "labkit.explore",
    "Experiment": "labkit.experiment", "Metric": "labkit.experiment", "ParameterError": "labkit.experiment", "Verdict": "labkit.experiment",
    "experiments": "labkit.experiments", "trace": "labkit.trace", "scheduler": "labkit.scheduler",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        module = import_module(_HOME[name])
        return module if name in ("trace", "scheduler") else getattr(module, name)
    experiments = import_module("labkit.experiments")
    if name in experiments.MODULES:
        return getattr(experiments, name)
    raise AttributeError(f"module 'labkit' has no attribute {name!r}")
