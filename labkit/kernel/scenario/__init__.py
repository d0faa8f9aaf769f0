"""Scenarios: task sets as data, in the JSON format of tests/oracle/freertos and freertos2, and a run of one as two CSV files."""

from labkit.kernel.scenario.play import run_scenario
from labkit.kernel.scenario.read import Scenario, read_scenario
from labkit.kernel.scenario.write import write_events, write_timeline

__all__ = ["Scenario", "read_scenario", "run_scenario", "write_events", "write_timeline"]
