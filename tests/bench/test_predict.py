"""A guess before the answer: what is a number, how near it is, which bench waits for it, and the raised hands of a hall."""

import pytest

from labkit.bench import explore, guesses, predict
from labkit.bench.guess import judge, read_number
from labkit.bench.predict import asked
from labkit.bench.vote import Vote
from labkit.experiment import Metric, ParameterError
from tests.bench.test_bench import page_of
from tests.bench.toys import Rolling


@pytest.fixture(autouse=True)
def nothing_asked():
    asked.clear()


def decide(box, guess=None):
    """Type a guess, press the button; what the question answers."""
    entry, *_ = box.children[1].children
    if guess is not None:
        entry.value = guess
    next(c for c in box.children[1].children if "lab-predict-reveal" in c._dom_classes).click()
    return box.children[2].value


def veiled(bench):
    return any(content["kind"] == "veil" and content["veiled"] for content, _ in page_of(bench))


def test_predict_answers_only_when_asked_and_says_how_near_it_was():
    box = predict("How far?", Rolling(), "distance")
    assert box.children[2].value == ""
    assert "You said <b>100 mm</b>: too low. The model says <b>125 mm</b>" in decide(box, "100")
    assert ": right." in decide(box, "124") and ": near, within 10%." in decide(box, "130")
    assert ": too high." in decide(box, "200")
    assert "is no number" in decide(box, "far") and "You said" not in decide(box, "")


def test_enter_decides():
    box = predict("How far?", Rolling(), "distance")
    box.children[1].children[0].value = "125"
    box.children[1].children[0]._handle_custom_msg({"event": "submit"}, [])
    assert ": right." in box.children[2].value


def test_predict_names_the_metrics_there_are():
    with pytest.raises(ParameterError, match="rolling has no metric 'height'; it has distance"):
        predict("How high?", Rolling(), "height")


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("13", "ms", 13),
        (" 13 ms ", "ms", 13),
        ("1,5", "ms", 1.5),
        ("1.5ms", "ms", 1.5),
        (".5", "%", 0.5),
        ("0.013 s", "ms", 13),
        ("13000 us", "ms", 13),
        ("1 000", "", 1000),
        ("2e3", "Hz", 2000),
        ("-3.1", "us more", -3.1),
        ("", "ms", ""),
    ],
)
def test_numbers_as_people_write_them(text, unit, value):
    assert read_number(text, unit) == pytest.approx(value) if value != "" else read_number(text, unit) == ""


@pytest.mark.parametrize(
    ("text", "unit", "sentence"),
    [
        ("nan", "ms", "is no number that can be compared; write it like 13 or 13 ms"),
        ("inf", "ms", "is no number"),
        ("1e999", "ms", "finite"),
        ("-1", "ms", "not negative"),
        ("13 m", "ms", "in ms, not in 'm'"),
        ("13 ms", "", "a bare number"),
        ("1,000", "ms", "could be 1000 or 1.000"),
        ("far", "", "is no number"),
    ],
)
def test_other_numbers_are_refused_with_a_sentence(text, unit, sentence):
    with pytest.raises(ValueError, match=sentence):
        read_number(text, unit)


def test_judgement():
    assert judge(100.9, Metric("x", 100)) == "right" and judge(91, Metric("x", 100)) == "near, within 10%"
    assert judge(0.0, Metric("x", 0)) == "right" and judge(1.0, Metric("x", 0)) == "too high"
    assert judge("EDF", Metric("x", "EDF")) == "right" and judge("RM", Metric("x", "EDF")) == "the model disagrees"
    assert judge("", Metric("x", 1)) == "not guessed"


def test_a_bench_waits_for_its_question_and_only_for_its_own():
    first = predict("How far?", Rolling(), "distance")
    bench = explore(Rolling)
    assert veiled(bench)
    assert not veiled(explore(Rolling, speed=300))  # the question belongs to the first bench
    assert veiled(explore(Rolling))  # whose cell ran again
    sent = page_of(bench)
    decide(first, "7")
    assert sent[-1][0] == {"kind": "veil", "veiled": False} and not veiled(bench)
    predict("How far?", Rolling(), "distance")  # everything runs again: the guess is still there
    assert not veiled(explore(Rolling))


def test_two_questions_are_both_awaited_and_show_me_lifts_the_veil_without_a_guess():
    one, _ = predict("How far?", Rolling(), "distance"), predict("And wet?", Rolling(floor="wet"), "distance")
    bench = explore(Rolling)
    decide(one, "7")
    assert veiled(bench)
    bench.plot._received(None, {"lift": True}, ())
    assert not veiled(bench)
    assert "7</td><td>125 mm" in guesses().value and "not guessed" in guesses().value


def test_guesses_are_a_table_that_fills():
    box, table = predict("How <far>?", Rolling(), "distance"), guesses()
    assert "How &lt;far&gt;?" in table.value and "not decided yet" in table.value
    decide(box, "130")
    assert "<td>130</td><td>125 mm</td><td>near, within 10%</td>" in table.value


def test_hands_are_counted_per_choice_and_per_number():
    vote = Vote(["yes", "no"], "")
    vote.count("yes", 1)
    vote.count("no", -1)
    assert vote.hands == {"yes": 1, "no": 0}
    vote = Vote([], "ms")
    for said in ("13", "13 ms", "2", "far"):
        vote.call(said)
    assert vote.hands == {"13": 2, "2": 1}
    bars = [row.children[2].value for row in vote._rows.children]
    assert "2 ms" in bars[0] and "13 ms" in bars[1] and "the model" not in "".join(bars)
    vote.reveal(Metric("x", 13, "ms"))
    assert "the model" in vote._rows.children[1].children[2].value
