"""Notebook 04: the story of a failure, the ring in motion against arithmetic, damaged frames, and the exercises."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.experiment import Superseded, progress_listener
from labkit.experiments.frame_lab import FrameLab, check_word_proof, damaged
from labkit.experiments.ring_in_motion import RingInMotion, check_slowest_link
from labkit.experiments.trace_sink import SHOWN, SinkStory, check_cure, check_lucky_priorities, memory
from labkit.sink import VARIANTS, Ring, check_sink, encode_frame, sample_run


def traces(figure):
    return {trace.get("name"): trace for trace in figure["data"]}


def test_the_shortest_failure_of_source_1():
    told = SinkStory().run()
    assert (told.check.verdict, len(told.check.steps)) == ("stale", 5)
    drawn = traces(SinkStory().figure(told))
    assert drawn["done"]["y"] == [1, 2, 3, 4, 5] and drawn["to come"]["y"] == []
    assert drawn["read from"]["x"] == [0, 2, None] and drawn["read from"]["y"] == [3, 4, None]  # P1 wrote what the consumer reads
    assert drawn["failure"]["x"] == [2]


def test_the_story_is_told_as_far_as_asked():
    told = SinkStory().run()
    for step in range(6):
        drawn = traces(SinkStory(step=step).figure(told))
        assert len(drawn["done"]["y"]) == step and len(drawn["to come"]["y"]) == 5 - step
        assert len(drawn["failure"]["x"]) == (step == 5)


def test_an_arrow_of_this_step_stands_out():
    drawn = traces(SinkStory(step=4).figure(SinkStory().run()))
    assert drawn["read from"]["x"] == [] and drawn["read from, this step"]["y"] == [3, 4, None]


def test_memory_follows_the_steps():
    told = SinkStory().run()
    values = [{cell.name: cell.value for cell in memory(told.check.ring, told.steps, n)} for n in range(6)]
    assert [v["write"] for v in values] == ["15", "15", "15", "0", "0", "0"] and {v["read"] for v in values} == {"15"}
    cells = {cell.name: cell for cell in memory(told.check.ring, told.steps, 5)}
    assert cells["buf[1]"].filled and cells["buf[1]"].touched and cells["buf[1]"].value == "–"
    assert not cells["buf[0]"].filled and cells["buf[0]"].remark == "◀ write" and cells["buf[1]"].remark == "◀ read"


def test_full_is_what_the_consumer_looks_at():
    told = SinkStory(variant="ready-flag").run()
    stored = next(n for n, step in enumerate(told.steps, 1) if step.variable.startswith("ready[") and step.access == "write")
    slot = told.steps[stored - 1].variable.replace("ready", "buf")
    for n, expected in ((stored - 1, False), (stored, True)):  # the byte is there before, but not yet announced
        cell = next(cell for cell in memory(told.check.ring, told.steps, n) if cell.name == slot)
        assert cell.value != "–" and cell.filled is expected
    told = SinkStory(variant="sequence").run()
    took = next(n for n, step in enumerate(told.steps, 1) if step.who == "consumer" and step.variable.startswith("buf["))
    cells = {cell.name: cell for cell in memory(told.check.ring, told.steps, took)}
    assert cells[told.steps[took - 1].variable].filled and "read" not in cells


def test_memory_shows_what_a_variable_held_before_its_first_access():
    told = SinkStory(variant="published-first-mutex").run()
    shown = [{cell.name: cell.value for cell in memory(told.check.ring, told.steps, n)} for n in (0, 1)]
    assert [values["mutex"] for values in shown] == ["0", "1"]


@pytest.mark.parametrize("variant", ["ready-flag", "sequence", "interrupts-off"])
@pytest.mark.parametrize("schedule", ["free", "higher", "equal", "lowest"])
def test_a_correct_variant_shows_a_run_in_which_all_is_sent(variant, schedule):
    experiment = SinkStory(variant=variant, schedule=schedule)
    told = experiment.run()
    assert told.check.verdict == "ok" and not told.check.steps
    sent = [step.value for step in told.steps if step.who == "consumer" and step.variable.startswith("buf")]
    assert sorted(sent) == ["P1/1", "P1/2", "P2/1", "P2/2"]
    assert traces(experiment.figure(told))["failure"]["x"] == []


def test_a_sample_run_ends_where_it_fails_or_when_it_is_long():
    ring = Ring(1, 1, 1, 2, 16)
    runs = [sample_run("published-first", ring, seed=seed) for seed in range(40)]
    ends = {run[-1].value for run in runs}
    assert ends == {"never written", "P1/1"}  # some fail, some are lucky
    assert len(sample_run("ready-flag", Ring(), most=7)) == 7


def words(figure):
    return " | ".join(note["text"] for note in figure["layout"]["annotations"])


def test_the_picture_names_its_variant_and_its_schedule():
    experiment = SinkStory(variant="batch-assert", schedule="lowest")
    assert "an asserting batch under the mutex against single writes without it; one core, consumer below" in words(
        experiment.figure(experiment.run())
    )


def test_a_failure_that_does_not_fit_is_marked_as_cut():
    experiment = SinkStory(variant="atomic-push", schedule="lowest", bytes=2, capacity=4, dma=True)
    told = experiment.run()
    more = len(told.check.steps) - SHOWN
    assert more > 0
    drawn = experiment.figure(told)
    assert f"CUT: {more} more steps do not fit the picture; in the end torn" in words(drawn)
    assert traces(drawn)["failure"]["x"] == []  # its step is not in the picture
    assert "CUT" not in words(experiment.replace(step=SHOWN - 1).figure(told))
    short = SinkStory()
    assert "CUT" not in words(short.figure(short.run()))


def test_with_a_dma_the_stale_byte_is_what_the_dma_reads():
    told = SinkStory(dma=True).run()
    assert told.check.verdict == "stale" and told.steps[-1].who == "DMA"
    drawn = SinkStory(dma=True).figure(told)
    assert "<b>DMA</b>" in drawn["layout"]["xaxis"]["ticktext"] and traces(drawn)["failure"]["x"] == [3]


def test_a_superseded_search_stops():
    heard = []

    def listen(fraction):
        heard.append(fraction)
        if len(heard) == 500:
            raise Superseded

    ours = progress_listener.set(listen)
    try:
        with pytest.raises(Superseded):
            SinkStory(variant="sequence", producers=3).run()
    finally:
        progress_listener.reset(ours)
    assert len(heard) == 500 and heard == sorted(heard) and 0 < heard[-1] < 0.01  # of the budget


def test_every_failure_fits_the_picture():
    for variant, known in VARIANTS.items():
        for schedule in ("free", "higher", "equal", "lowest"):
            assert len(check_sink(variant, Ring(2, 2, known.bytes, 4, 32), schedule, 60_000).steps) <= SHOWN


def test_too_many_states_are_not_decided():
    found = SinkStory(variant="sequence", producers=3, messages=2)
    verdict = found.metrics(found.run())[0]
    assert verdict.value == "undecided" and verdict.good is None


def test_indices_that_wrap_beside_the_ring():
    sound, broken = (
        SinkStory(variant="ready-flag", capacity=3, messages=1, producers=3, indices=i) for i in ("multiple", "four_bits")
    )
    assert sound.run().check.verdict == "ok" and broken.run().check.verdict == "overwritten"


@pytest.mark.parametrize("rates", ["100|50", "1000"])
@pytest.mark.parametrize("form", ["text", "word"])
def test_arithmetic_and_simulation_agree_where_nothing_is_lost(rates, form):
    experiment = RingInMotion(rates=rates, form=form)
    result = experiment.run()
    load, busy = (metric.value for metric in experiment.metrics(result)[:2])
    assert result.lost() == 0 and load == pytest.approx(busy, abs=2)


def test_stamps_that_nobody_has_counted_yet_are_lost_too():
    result = RingInMotion(baud=115_200).run()
    assert result.sink.table()[:, 2:].sum() == 0 and result.lost() > 100


def test_the_indices_are_those_of_the_sink():
    result = RingInMotion().run()
    drawn = traces(RingInMotion(start=0, end=100).figure(result))
    capacity, sink = 2048, result.sink
    assert drawn["write"]["y"][-1] == sink.written % capacity and drawn["read"]["y"][-1] == sink.read % capacity
    assert drawn["bytes in the ring"]["y"][-1] == sink.fill
    gaps = (drawn["write"]["y"] - drawn["read"]["y"]) % capacity
    fills = drawn["bytes in the ring"]["y"]
    assert np.array_equal(gaps, fills % capacity)


def test_a_ring_that_comes_around_goes_out_in_two_chunks():
    result = RingInMotion().run()
    ends = np.cumsum(result.sink.transfers()[:, 2])
    wraps = range(2048, ends[-1] + 1, 2048)
    assert len(wraps) > 3 and set(wraps) <= set(ends)  # no transfer crosses the end of the ring


@given(FrameLab.strategy())
def test_what_the_robot_takes_is_what_was_sent(experiment):
    result = experiment.run()
    if result.reception.verdict == "ok":
        assert result.received == result.sent
        assert (result.reception.x, result.reception.y, result.reception.z) == (experiment.x, experiment.y, experiment.z)


@pytest.mark.parametrize(
    "damage, unit, verdict",
    [
        ("none", "bytes", "ok"),
        ("none", "words", "crc"),
        ("bit", "bytes", "crc"),
        ("cut", "bytes", "short"),
        ("doubled", "words", "long"),
        ("exchanged", "bytes", "crc"),
        ("glued", "bytes", "long"),
    ],
)
def test_verdicts_of_damaged_frames(damage, unit, verdict):
    assert FrameLab(damage=damage, unit=unit).values()["verdict"] == verdict


def test_a_word_fed_unit_takes_the_frame_of_a_robot_at_rest():
    assert FrameLab(damage="none", unit="words", x=0, y=0, z=0).values()["verdict"] == "ok"


@settings(max_examples=50)
@given(st.integers(0, 27), st.integers(0, 7))
def test_damage_does_what_it_says(byte, bit):
    frame = bytes(range(28))
    assert len(damaged(frame, "cut", byte, bit)) == 27 and len(damaged(frame, "doubled", byte, bit)) == 29
    flipped = damaged(frame, "bit", byte, bit)
    assert [a ^ b for a, b in zip(frame, flipped, strict=True)] == [(1 << bit) * (i == byte) for i in range(28)]
    exchanged = damaged(frame, "exchanged", byte, bit)
    assert sorted(exchanged) == sorted(frame) and (exchanged != frame) == (byte < 27)


def test_exercises_know_right_from_wrong():
    assert check_cure(SinkStory(variant="ready-flag", bytes=2)).solved
    assert not check_cure(SinkStory(variant="ready-flag")).solved  # one byte proves too little
    assert not check_cure(SinkStory(variant="consumer-mutex", bytes=2)).solved
    assert check_lucky_priorities(SinkStory(schedule="lowest")).solved
    assert not check_lucky_priorities(SinkStory(schedule="equal")).solved
    assert not check_lucky_priorities(SinkStory(variant="ready-flag", schedule="lowest")).solved
    result = RingInMotion(baud=12_500_000).run()
    right = result.stamps * result.sizes.mean() * 10
    assert check_slowest_link(right).solved and check_slowest_link(1.02 * right).solved
    assert not check_slowest_link(1.05 * right).solved and not check_slowest_link(float("nan")).solved
    palindrome = struct.unpack(">d", bytes.fromhex("3FE0E03F00000000"))[0]
    assert check_word_proof((palindrome, 0, 0)).solved and encode_frame(palindrome, 0, 0)[4:8] == bytes.fromhex("3FE0E03F")
    assert not check_word_proof((1.0, 0, 0)).solved and not check_word_proof((0, 0, 0)).solved
    assert not check_word_proof("walk").solved
