"""The experiments of the notebooks: parameters -> result -> figure. Each module is imported when first asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from labkit.experiment import Experiment, ParameterError

#: Class -> module, in teaching order. A new experiment is one line here.
MODULES: dict[str, str] = {
    "ThreeTasks": "start_here",
    "OwnRecording": "own_recording",
    "PriorityInversion": "priority_inversion",
    "NestedMutexes": "nested_mutexes",
    "MarsPathfinder": "mars_pathfinder",
    "QueueLab": "messages",
    "SignalLab": "messages",
    "MutualExclusion": "mutual_exclusion",
    "TimerTask": "timer_task",
    "SpeedupGuess": "cache_speedups",
    "PublishedSpeedups": "cache_speedups",
    "CacheMap": "cache_patterns",
    "MissRates": "cache_patterns",
    "MatrixOrders": "cache_patterns",
    "TimingModel": "cache_timing",
    "Explanations": "cache_timing",
    "DmaCoherence": "dma_coherence",
    "Alignment": "dma_coherence",
    "UrosSession": "dma_session",
    "SinkStory": "trace_sink",
    "RingInMotion": "ring_in_motion",
    "FrameLab": "frame_lab",
    "TornFrame": "torn_frame",
    "TickRates": "tick_rates",
    "Listings": "listings",
    "LongRun": "tick_rates",
    "TickBound": "tick_bound",
    "RobotPath": "robot_path",
    "PathAgainstRate": "robot_path",
    "MicroRosRate": "micro_ros",
    "ExecutorRounds": "micro_ros_rounds",
    "RateCurves": "micro_ros",
    "PublishedTables": "micro_ros_tables",
    "QueueOrMiddleware": "micro_ros_tables",
    "Schedules": "schedulability",
    "ResponseBounds": "schedulability",
    "StarvedPair": "schedulability",
    "ExpectedTime": "acceptance",
    "AcceptanceCurves": "acceptance",
    "OwnTaskSet": "own_tasks",
    "PhaseWindows": "taft_phases",
    "SixDesigns": "taft_phases",
    "Timeliness": "taft_phases",
    "CoherentStretches": "global_time_starts",
    "ClockSync": "global_time",
    "PeriodStarts": "global_time_starts",
    "TimestampDrift": "global_time_drift",
    "GroupCommunication": "group_communication",
    "OneLoss": "group_patterns",
    "LossPatterns": "group_patterns",
    "OmissionDegrees": "group_communication",
    "LaserPipeline": "laser_pipeline",
    "CircleFits": "circle_fits",
    "AnytimeStages": "laser_anytime",
    "FusedViews": "laser_views",
    "TwoStations": "kalman_fusion",
    "GateShare": "kalman_gate",
    "CrossingElements": "kalman_gate",
    "ClaimedError": "kalman_consistency",
    "FusionLevels": "fusion_levels",
    "OneFastObject": "one_fast_object",
    "DistributedFusion": "distributed_fusion",
}


#: What the exercises need beside the experiments: the check of each, and what two of them work on; name -> module.
EXERCISES: dict[str, str] = {
    "check_most_work": "start_here",
    "check_most_work_at_30": "start_here",
    "check_harmless_inversion": "priority_inversion",
    "check_bound_reached": "priority_inversion",
    "check_prompt_middle": "nested_mutexes",
    "check_shortest_queue": "messages",
    "check_prompt_beats": "timer_task",
    "check_wrong_total": "cache_speedups",
    "check_idle_formula": "cache_speedups",
    "check_sample_difference": "cache_speedups",
    "check_coldest": "cache_timing",
    "check_full_of_holes": "cache_patterns",
    "check_fifo_beats_lru": "cache_patterns",
    "check_good_order": "cache_patterns",
    "check_failures": "dma_exercises",
    "check_rounding": "dma_exercises",
    "check_receive_driver": "dma_exercises",
    "check_region": "dma_exercises",
    "check_cure": "trace_sink",
    "check_lucky_priorities": "trace_sink",
    "check_slowest_link": "ring_in_motion",
    "check_word_proof": "frame_lab",
    "check_untorn": "torn_frame",
    "check_no_loss": "tick_rates",
    "check_tick_bound": "tick_bound",
    "check_whole_way": "robot_path",
    "check_next_gap": "listings",
    "check_thousand": "micro_ros",
    "check_longer_is_faster": "micro_ros",
    "check_fair_sum": "micro_ros_tables",
    "check_idle_share": "micro_ros_tables",
    "cells": "micro_ros_tables",
    "printed": "micro_ros_tables",
    "check_rm_misses": "schedulability",
    "check_beyond_the_bounds": "schedulability",
    "check_fed_pair": "schedulability",
    "check_expected_time": "acceptance",
    "check_period": "taft_phases",
    "check_few_aborts": "taft_phases",
    "check_chain": "taft_phases",
    "check_interval": "global_time",
    "check_bound_broken": "global_time",
    "check_stretch": "global_time_starts",
    "check_reserve": "global_time_starts",
    "check_in_phase": "global_time_starts",
    "check_read_error": "global_time_drift",
    "check_degree": "group_communication",
    "check_bursts": "group_communication",
    "check_two_generals": "group_patterns",
    "check_leaves": "group_patterns",
    "check_offset": "kalman_fusion",
    "check_clocks": "kalman_fusion",
    "check_noise": "kalman_fusion",
    "check_gate": "kalman_gate",
    "check_fast_ball": "laser_pipeline",
    "check_rolling": "laser_pipeline",
    "check_shortest_time": "laser_anytime",
    "check_two_balls": "laser_views",
    "check_split": "team_exercises",
    "check_ghost": "team_exercises",
    "check_threshold": "team_exercises",
    "over_scenes": "fusion_levels",
    "agent": "dma_session",
    "CREATE_CLIENT": "dma_session",
}


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return [*MODULES, *EXERCISES, "experiments", "find"]
    module = MODULES.get(name) or EXERCISES.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{module}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})


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
