"""A guess before the answer."""

import pytest

from labkit.bench import predict
from labkit.experiment import ParameterError
from tests.bench.toys import Rolling


def ask(box, guess):
    entry, answer = box.children[1].children[0], box.children[2]
    entry.value = guess
    next(c for c in box.children[1].children if "lab-predict-reveal" in c._dom_classes).click()
    return answer.value


def test_predict_answers_only_when_asked_and_compares():
    box = predict("How far?", Rolling(), "distance")
    assert box.children[2].value == ""
    assert "You said <b>100 mm</b>" in ask(box, "100") and "The model says <b>125 mm</b>" in ask(box, "100")
    assert "#009E73" in ask(box, "124") and "#009E73" not in ask(box, "100")
    assert "Write a number" in ask(box, "far") and "You said" not in ask(box, "")


def test_predict_names_the_metrics_there_are():
    with pytest.raises(ParameterError, match="rolling has no metric 'height'; it has distance"):
        predict("How high?", Rolling(), "height")
