"""Every recorded scenario of the real FreeRTOS kernel, byte for byte: the timeline and all events."""

import io
from pathlib import Path

import pytest

from labkit.kernel import read_scenario, run_scenario, write_events, write_timeline

RECORDINGS = sorted((Path(__file__).parents[1] / "oracle" / "freertos").glob("*.json"))


def test_all_recordings_are_here():
    assert len(RECORDINGS) == 59


@pytest.mark.parametrize("scenario", RECORDINGS, ids=lambda path: path.stem)
def test_the_model_does_what_the_real_kernel_did(scenario):
    run = run_scenario(read_scenario(scenario))
    timeline, events = io.StringIO(), io.StringIO()
    write_timeline(run, timeline)
    write_events(run, events)
    assert timeline.getvalue() == scenario.with_suffix(".timeline.csv").read_text()
    assert events.getvalue() == scenario.with_suffix(".csv").read_text()
