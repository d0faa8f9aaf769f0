"""Widgets: `explore` makes a bench of any experiment, `predict` asks for a guess. Knows only the Experiment contract."""

from labkit.bench.bench import Bench, explore
from labkit.bench.predict import predict

__all__ = ["Bench", "explore", "predict"]
