"""Widgets: `explore` makes a bench of any experiment, `predict` asks for a guess, `guesses` is the table of all guesses.

Knows only the Experiment contract.
"""

from labkit.bench.bench import Bench, explore
from labkit.bench.predict import guesses, predict

__all__ = ["Bench", "explore", "guesses", "predict"]
