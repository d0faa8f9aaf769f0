"""Notebook 12: what the benches say, and that their exercises ask the model."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from labkit.experiments.kalman_consistency import ClaimedError
from labkit.experiments.kalman_fusion import TwoStations, check_clocks, check_noise, check_offset
from labkit.experiments.kalman_gate import CrossingElements, GateShare, check_gate
from labkit.figures import ellipse


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0, 3.0])
def test_the_stamp_decides_and_not_the_speed(speed):
    stamped, read = (TwoStations(speed=speed, stamp=stamp).values() for stamp in ("measured", "read"))
    assert stamped["error of the filter"] == pytest.approx(3.29, rel=0.02)
    assert stamped["error of the average"] == pytest.approx(stamped["error of the average, by arithmetic"], rel=0.02)
    assert read["error of the filter"] > 0.9 * read["error of the average"]


def test_the_filter_claims_what_is_true_if_q_and_r_are():
    honest = TwoStations(speed=1.0, q="0", seed=1).values()
    assert honest["NEES"] == pytest.approx(4, abs=0.15)
    assert honest["claimed by the filter"] == pytest.approx(honest["error of the filter"], rel=0.05)
    assert TwoStations(q="0", assumed=0.25).measure("NEES") > 40
    assert TwoStations(q="0", model="ca", speed=0.0).measure("NEES") == pytest.approx(6, abs=0.2)
    assert TwoStations(q="0", model="cp", speed=0.0).measure("NEES") == pytest.approx(2, abs=0.1)
    assert TwoStations(q="0", course="circle").measure("NEES") > 100


def test_a_wrong_clock_is_an_error_of_place():
    errors = [TwoStations(speed=2, clock_error=ms).measure("error of the filter") for ms in (-50, -20, 0, 20, 50)]
    assert errors[0] > errors[1] > errors[2] < errors[3] < errors[4] and errors[4] > 8


def test_the_ellipse_holds_its_share():
    P = np.array([[4.0, 1.0], [1.0, 1.0]])
    line = ellipse(2 + 1j, P, 0.9) - (2 + 1j)
    squared = [np.real([z.real, z.imag] @ np.linalg.inv(P) @ [z.real, z.imag]) for z in line]
    assert squared == pytest.approx([-2 * np.log(0.1)] * len(line))


@pytest.mark.parametrize(("course", "told"), [("straight", 7.5), ("circle", 32)])
def test_the_gate_of_the_source_rejects_what_is_true(course, told):
    values = GateShare(course=course).values()
    assert values["rejected by (5.32)"] == pytest.approx(told, abs=0.5)
    assert values["rejected by Mahalanobis"] < 0.5
    assert values["second look rejected by (5.32)"] > 90


def test_what_is_left_out_behind_that_gate_is_lost():
    lost = GateShare(course="circle", rejected="left out").values()
    assert lost["rejected by (5.32)"] > 80 and lost["error behind (5.32)"] > 100
    assert lost["error behind Mahalanobis"] < 5


def test_claims_of_the_sources_filter():
    values = ClaimedError(q="0").values()
    assert values["real error at the end"] == pytest.approx(1.25, abs=0.01)
    assert values["claimed error at the end"] == pytest.approx(0.60, abs=0.005)
    incest = ClaimedError(q="0", filter="own P").values()
    assert incest["real error at the end"] > 50 and incest["claimed error at the end"] < 1e-6 and incest["expected NEES"] is None


def test_the_mean_nees_of_the_picture_is_what_is_expected():
    for kind in ("textbook", "source"):
        result = ClaimedError(filter=kind, q="0.1", steps=200).run()
        values = ClaimedError(filter=kind, q="0.1", steps=200).values()
        assert result.nees[kind][20:].mean() == pytest.approx(values["expected NEES"], rel=0.08)


def test_sound_rules_keep_four_elements_apart_and_the_sources_does_not():
    for rule in ("global", "joint"):
        found = CrossingElements(rule=rule).values()
        assert found["track switches"] == 0 and found["confirmed tracks"] == 4
    assert CrossingElements(rule="source").measure("track switches") > 5


def test_false_detections_are_dropped_unconfirmed():
    found = CrossingElements(elements=1, false=2.0).values()
    assert found["dropped unconfirmed"] > 10 and found["mean OSPA"] < 30


def test_every_solution_printed_in_the_notebook_is_one():
    notebook = json.loads((Path(__file__).parents[2] / "notebooks" / "12_kalman_fusion.ipynb").read_text(encoding="utf-8"))
    text = "\n".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown")
    folded = "\n".join(re.findall(r"<details>.*?</details>", text, flags=re.S))
    printed = re.findall(r"`(check_\w+\(.*?\))`", folded)
    assert len(printed) == 6 and folded.count("<summary>") == 4
    for answer in printed:
        assert eval(answer).solved, answer


def test_exercises_ask_the_model():
    assert check_offset(30).solved and not check_offset(160).solved and not check_offset(10).solved
    assert not check_offset("30").solved and not check_offset(float("nan")).solved
    solved = [ms for ms in range(20) if check_clocks(ms).solved]
    assert len(solved) == 1 and 6 <= solved[0] <= 8
    assert not check_clocks(True).solved and not check_clocks(50).solved
    assert not check_noise(TwoStations(course="circle")).solved
    assert (
        check_noise(TwoStations(course="circle", q="0.3")).solved
        and check_noise(TwoStations(course="circle", q="0.3", period=3)).solved
    )
    assert "only" in check_noise(TwoStations(course="circle", q="0.3", sigma=1)).text
    start = GateShare(course="circle", rejected="left out")
    assert not check_gate(start).solved and not check_gate(start.replace(e_max=10)).solved
    assert check_gate(start.replace(e_max=8)).solved and not check_gate(GateShare(e_max=8)).solved
