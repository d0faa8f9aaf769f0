"""Widgets: `explore` makes a bench of any experiment, `predict` asks for a guess, `guesses` is the table of all guesses,
`task_set_editor` makes a bench whose parameter is a table.

Knows only the Experiment contract.
"""

from labkit.bench.bench import Bench, explore
from labkit.bench.predict import guesses, predict
from labkit.bench.taskset import task_set_editor

__all__ = ["Bench", "explore", "guesses", "predict", "task_set_editor"]
