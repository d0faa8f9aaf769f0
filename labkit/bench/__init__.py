"""Widgets: `explore` makes a bench of any experiment, `predict` asks for a guess. Knows only the Experiment contract."""

from labkit.bench.bench import Bench, explore, predict

__all__ = ["Bench", "explore", "predict"]
