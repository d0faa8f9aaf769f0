"""The experiments of the notebooks: parameters -> result -> figure. Each module is imported when first asked for."""

from __future__ import annotations

from importlib import import_module

from labkit.experiment import Experiment, ParameterError

#: Class -> module, in teaching order. A new experiment is one line here.
MODULES: dict[str, str] = {
    "ThreeTasks": "start_here",
    "PriorityInversion": "priority_inversion",
    "NestedMutexes": "priority_inversion",
    "MarsPathfinder": "priority_inversion",
    "QueueLab": "messages",
    "SignalLab": "messages",
    "SpeedupGuess": "cache_speedups",
    "PublishedSpeedups": "cache_speedups",
    "CacheMap": "cache_patterns",
    "MissRates": "cache_patterns",
    "MatrixOrders": "cache_patterns",
    "TimingModel": "cache_speedups",
    "Explanations": "cache_speedups",
    "DmaCoherence": "dma_coherence",
    "Alignment": "dma_coherence",
    "UrosSession": "dma_session",
    "Schedules": "schedulability",
    "ResponseBounds": "schedulability",
    "StarvedPair": "schedulability",
    "ExpectedTime": "acceptance",
    "AcceptanceCurves": "acceptance",
    "PhaseWindows": "taft_phases",
    "SixDesigns": "taft_phases",
    "Timeliness": "taft_phases",
}


def __getattr__(name: str) -> type[Experiment]:
    if name not in MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{MODULES[name]}"), name)


def experiments() -> dict[str, type[Experiment]]:
    """All experiments by their command-line name, in teaching order."""
    classes = [__getattr__(name) for name in MODULES]
    return {cls.name(): cls for cls in classes}


def find(name: str) -> type[Experiment]:
    """The experiment of that command-line name; ParameterError lists the names there are."""
    known = experiments()
    if name not in known:
        raise ParameterError(f"there is no experiment {name!r}; there are {', '.join(known)}")
    return known[name]
