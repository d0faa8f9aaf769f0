"""labkit: the models of the Real-Time Lab. Everything heavy is imported when first used.

`from labkit import explore, PriorityInversion` is all a notebook needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "explore": "labkit.bench",
    "predict": "labkit.bench",
    "guesses": "labkit.bench",
    "task_set_editor": "labkit.bench",
    "sweep": "labkit.sweeping",
    "published": "labkit.data",
    "published_table": "labkit.data",
    "Experiment": "labkit.experiment",
    "Metric": "labkit.experiment",
    "ParameterError": "labkit.experiment",
    "Feedback": "labkit.experiment",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name == "__all__":
        return [*_HOME, *import_module("labkit.experiments").MODULES]
    if not name.startswith("_"):
        experiments = import_module("labkit.experiments")
        if name in experiments.MODULES:
            return getattr(experiments, name)
    raise AttributeError(f"module 'labkit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})
