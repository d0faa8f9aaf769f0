"""Every recorded scenario of the real FreeRTOS kernel, byte for byte: the timeline and all events."""

import csv
import io
from pathlib import Path

import pytest

from labkit.kernel import read_scenario, run_scenario, write_events, write_timeline

ORACLE = Path(__file__).parents[1] / "oracle"
SCENARIOS = sorted((ORACLE / "freertos").glob("*.json"))
SERVICES = sorted((ORACLE / "freertos2").glob("*.json"))


def played(scenario: Path) -> tuple[str, str]:
    """The timeline and the events, as CSV."""
    run = run_scenario(read_scenario(scenario))
    timeline, events = io.StringIO(), io.StringIO()
    write_timeline(run, timeline)
    write_events(run, events)
    return timeline.getvalue(), events.getvalue()


def recorded(name: str) -> dict[str, list[list[str]]]:
    """A file of part 2: its rows by scenario, without that column."""
    found: dict[str, list[list[str]]] = {}
    with (ORACLE / "freertos2" / name).open(newline="") as file:
        for scenario, *row in list(csv.reader(file))[1:]:
            found.setdefault(scenario, []).append(row)
    return found


TIMELINES, EVENTS = recorded("timelines.csv"), recorded("events.csv")


def test_all_recordings_are_here():
    assert len(SCENARIOS) == 59
    assert len(SERVICES) == len(TIMELINES) == len(EVENTS) == 90


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem)
def test_the_model_does_what_the_real_kernel_did(scenario):
    timeline, events = played(scenario)
    assert timeline == scenario.with_suffix(".timeline.csv").read_text()
    assert events == scenario.with_suffix(".csv").read_text()


@pytest.mark.parametrize("scenario", SERVICES, ids=lambda path: path.stem)
def test_so_it_does_with_all_other_services(scenario):
    timeline, events = (list(csv.reader(io.StringIO(text)))[1:] for text in played(scenario))
    key = scenario.stem.split("_")[0]
    assert timeline == TIMELINES[key]
    assert events == EVENTS[key]
