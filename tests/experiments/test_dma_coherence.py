"""Notebook 03: the six failures and their cures through the benches, the alignment arithmetic, the session, the exercises."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.cache import SOURCE1_MPU, MpuRegion, stm32f767
from labkit.experiments.byte_story import CPU, DMA, LINE, Story
from labkit.experiments.dma_coherence import Alignment, DmaCoherence
from labkit.experiments.dma_exercises import DOCUMENTED, check_failures, check_receive_driver, check_region, check_rounding
from labkit.experiments.dma_session import CREATE_CLIENT, KEY, UrosSession, agent
from labkit.sweeping import sweep

FAILURES = {
    "transmit without clean": DmaCoherence(),
    "receive without invalidate": DmaCoherence(direction="receive"),
    "speculative fill": DmaCoherence(direction="receive", before="invalidate", meanwhile="speculation"),
    "dirty eviction": DmaCoherence(direction="receive", after="invalidate", meanwhile="eviction"),
    "invalidate hit a dirty neighbour": DmaCoherence(
        direction="receive", before="invalidate", after="invalidate", neighbour="during", offset=16
    ),
    "clean overwrote the DMA": DmaCoherence(
        direction="receive", before="invalidate", after="clean+invalidate", neighbour="during", offset=16
    ),
}


def test_the_switches_reach_all_six_documented_failures():
    assert {cause: experiment.run().causes for cause, experiment in FAILURES.items()} == {cause: (cause,) for cause in DOCUMENTED}


@settings(max_examples=60, deadline=None)
@given(DmaCoherence.strategy())
def test_memory_that_is_not_cached_cures_everything(experiment):
    for place in ("non_cacheable", "dtcm"):
        result = experiment.replace(place=place).run()
        assert all(result.arrived) and result.neighbour and not result.causes


@settings(max_examples=60, deadline=None)
@given(DmaCoherence.strategy())
def test_the_right_operations_on_whole_lines_cure_everything(experiment):
    before, after = ("clean", "none") if experiment.direction == "transmit" else ("invalidate", "invalidate")
    result = experiment.replace(offset=0, before=before, after=after).run()
    assert all(result.arrived) and result.neighbour and not result.causes


@settings(max_examples=80, deadline=None)
@given(DmaCoherence.strategy())
def test_a_byte_arrives_wrong_only_where_the_fold_over_the_records_finds_a_cause(experiment):
    result = experiment.run()
    assert (all(result.arrived) and result.neighbour) or result.causes
    for lane, reader in ((CPU, "CPU"), (DMA, "DMA")):
        wrong = sum(v.size for stage in result.stages for v in stage.wrong if v.reader == reader)
        assert result.stages[-1].lanes[lane].state.count("stale") == wrong  # in the end every byte read last is read once


@settings(max_examples=40, deadline=None)
@given(DmaCoherence.strategy())
def test_the_lanes_show_what_cache_and_memory_hold_and_stale_is_what_somebody_else_has_newer(experiment):
    for stage in experiment.run().stages:
        _, cache, memory, _ = stage.lanes
        for here, there, state, stored in zip(cache.text, memory.text, cache.state, memory.state):
            assert (state == "absent") == (here == "")
            if state == "newest":
                assert here == there and stored == "newest"
            if state == "dirty" and here != there:
                assert stored == "stale"


def test_write_through_cures_transmitting_only():
    assert DmaCoherence(place="write_through").measure("the receiver got") == "everything"
    assert DmaCoherence(place="write_through", direction="receive").measure("the receiver got") == "nothing of it"


def test_a_sweep_over_the_direction_has_a_number_in_every_row():
    table = sweep(DmaCoherence, direction=["transmit", "receive"], place=["cached", "dtcm"])
    assert table["the receiver got"].tolist() == ["nothing of it", "everything"] * 2
    assert not table.isna().any(axis=None)


@pytest.mark.parametrize("cls", [DmaCoherence, Alignment, UrosSession])
def test_a_step_is_a_view(cls):
    assert [p.name for p in cls.parameters() if p.view] == ["step"]
    assert cls(step=1).same_run(cls(step=2))


def test_cleaning_first_saves_a_neighbour_that_is_left_alone_during_the_transfer():
    shared = {"direction": "receive", "offset": 8, "after": "invalidate", "neighbour": "before"}
    assert DmaCoherence(**shared, before="invalidate").measure("neighbour") == "destroyed"
    assert DmaCoherence(**shared, before="clean+invalidate").measure("neighbour") == "intact"


@pytest.mark.parametrize("cls", [DmaCoherence, Alignment, UrosSession])
def test_at_the_start_of_a_story_no_card_knows_its_end(cls):
    first = cls(step=0)
    known = {m.name: m for m in first.metrics(first.run())}
    for name in {
        "the receiver got",
        "neighbour",
        "stale bytes read in the end",
        "the agent says",
        "stale bytes sent",
    } & known.keys():
        assert known[name].value is None and known[name].good is None


def test_a_card_knows_as_much_as_is_told():
    result = DmaCoherence().run()
    told = [DmaCoherence(step=step).metrics(result) for step in range(10)]
    assert [m[0].value for m in told] == [None] * 6 + ["nothing of it"] * 4
    assert [m[2].value for m in told] == ["nothing"] * 3 + ["transmit without clean"] * 7
    assert {m[2].good for m in told[:3]} == {None}
    lines = [
        DmaCoherence(step=step, offset=8, before="clean").metrics(DmaCoherence(offset=8, before="clean").run())[3].value
        for step in (1, 2, 9)
    ]
    assert lines == [0, 2, 2]


def test_the_strip_marks_only_failures_that_have_been_told():
    result = DmaCoherence().run()
    crossed = [sum("✗" in text for text in DmaCoherence(step=step).figure(result)["data"][0]["text"]) for step in range(10)]
    assert crossed == [0] * 3 + [1] * 3 + [2] * 4


def test_a_card_has_room_for_what_went_wrong():
    for one in FAILURES.values():
        assert len(one.measure("what went wrong")) <= 26
    two = DmaCoherence(after="invalidate")
    card = next(m for m in two.metrics(two.run()) if m.name == "what went wrong")
    assert card.value == "2 failures" and all(cause in card.note for cause in two.run().causes)


def test_with_the_heap_in_dtcm_no_region_matters():
    one, other = (UrosSession(heap="dtcm", mpu=mpu) for mpu in ("none", "heap"))
    assert one.figure(one.run()) == other.figure(other.run()) and "mpu" in one.without_effect()


def test_an_invalidated_packet_is_not_called_a_neighbour():
    assert DmaCoherence(before="invalidate").run().causes == ("invalidate dropped the packet",)


def test_the_step_slider_shows_one_stage_after_the_other():
    headlines, result = [], DmaCoherence().run()
    for step in range(10):
        figure = DmaCoherence(step=step).figure(result)
        headlines.append(figure["layout"]["meta"]["says"])
        assert figure["layout"]["meta"]["ended"] == (step == 9)
        assert figure["data"][0]["meta"]["set"][step] == {"step": step}
        assert figure["data"][0]["marker"]["color"].index("#0072B2") == step
    assert len(set(headlines)) == 10


@settings(max_examples=60, deadline=None)
@given(Alignment.strategy())
def test_alignment_follows_the_arithmetic(experiment):
    _, done, stale = experiment.run()
    span = experiment.size + (experiment.offset if experiment.size_rule == "with_offset" else 0)
    end = experiment.offset + experiment.size
    assert len(done.lines) == -(-span // LINE) and done.lines.start % LINE == 0
    worked = len(done.lines) * LINE
    assert sum(size for _, size in done.neighbours) == min(worked, experiment.offset) + max(0, worked - end)
    missed = max(0, end - worked)
    assert (done.missed[1] if done.missed else 0) == missed
    if experiment.operation == "clean":
        assert stale == missed  # rounding a clean outwards harms nobody
    elif experiment.operation == "invalidate":
        others = min(worked, experiment.offset) + max(0, worked - end)
        held = missed > 0  # the line that was missed is still held, with what stood there before
        assert stale == others + (missed if held else 0)


def test_the_session_of_source_1():
    zeros = UrosSession().run()
    assert zeros.received == bytes(len(CREATE_CLIENT)) and agent(zeros.received) == "invalid client key"
    assert UrosSession(mpu="none").run().received == zeros.received  # source 1's regions change nothing
    for cure in ({"driver": "with_offset"}, {"mpu": "heap"}, {"heap": "dtcm"}):
        assert UrosSession(**cure).run().received == CREATE_CLIENT


@pytest.mark.parametrize("offset", range(LINE))
def test_a_forgotten_offset_loses_the_tail(offset):
    sent = UrosSession(driver="size_only", offset=offset).run().received
    missed = max(0, offset + len(CREATE_CLIENT) - LINE)
    kept = len(CREATE_CLIENT) - missed
    assert sent == CREATE_CLIENT[:kept] + bytes(missed)
    assert UrosSession(driver="with_offset", offset=offset).run().received == CREATE_CLIENT


def test_a_stale_zero_is_stale_although_it_is_right():
    last = UrosSession().run().stages[-1]
    assert set(last.lanes[DMA].state) == {"stale"} and sum(v.size for v in last.wrong) == len(CREATE_CLIENT)


def test_the_agent_reads_the_header_first():
    assert agent(CREATE_CLIENT) == "session established"
    assert agent(CREATE_CLIENT[: KEY.start] + bytes(4) + CREATE_CLIENT[KEY.stop :]) == "invalid client key"
    assert agent(CREATE_CLIENT[:8] + b"abcd" + CREATE_CLIENT[12:]) == "cookie is not XRCE"
    assert agent(bytes.fromhex("81000000 04010B00") + bytes(16)) == "no CREATE_CLIENT"


def test_a_story_counts_lost_lines_and_marks_them():
    story = Story(stm32f767(), 0x2002_0000, LINE)
    with story.stage("write", ""):
        story.cache.write(0x2002_0000, b"abc")
    with story.stage("drop", ""):
        story.cache.invalidate(0x2002_0000, 3)
    write, drop = story.stages()
    assert (write.lost, drop.lost) == (0, 1)
    assert write.lanes[1].dirty == ((0, LINE),) and not drop.lanes[1].dirty
    assert {move.kind for move in drop.moves} == {"lost"} and len(drop.moves) == LINE


def test_exercise_1_wants_all_six():
    assert check_failures(list(FAILURES.values())).solved
    for cause in FAILURES:
        verdict = check_failures([e for name, e in FAILURES.items() if name != cause])
        assert not verdict.solved and cause in verdict.text


def test_exercise_2_runs_every_offset_and_size():
    assert check_rounding(lambda address, size: (address & ~0x1F, size + (address & 0x1F))).solved
    assert "must lie on a line" in check_rounding(lambda address, size: (address, size)).text
    assert "stale" in check_rounding(lambda address, size: (address & ~0x1F, size)).text
    assert "would do" in check_rounding(lambda address, size: (address & ~0x1F, size + 32)).text


def driver(before=(), after=()):
    def receive(cache, dma, buffer, frame):
        for operation in before:
            getattr(cache, operation)(buffer, len(frame))
        dma.write(buffer, frame)
        for operation in after:
            getattr(cache, operation)(buffer, len(frame))
        return cache.load(buffer, len(frame))

    return receive


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        (["invalidate"], ["invalidate"], None),
        (["clean", "invalidate"], ["invalidate"], None),
        (["clean"], ["invalidate"], None),  # nothing dirty is left to be evicted, and what is prefetched is dropped
        (["clean_invalidate"], ["invalidate"], None),
        ([], [], "receive without invalidate"),
        (["invalidate"], [], "speculative fill"),
        ([], ["invalidate"], "dirty eviction"),
        ([], ["clean_invalidate"], "clean overwrote the DMA"),
    ],
)
def test_exercise_3_names_the_scene_that_fails(before, after, complaint):
    verdict = check_receive_driver(driver(before, after))
    assert verdict.solved if complaint is None else not verdict.solved and complaint in verdict.text


@pytest.mark.parametrize("check", [check_failures, check_rounding, check_receive_driver, check_region])
@pytest.mark.parametrize("answer", [None, 12, "clean", [1, 2], DmaCoherence, lambda: None])
def test_an_answer_of_another_kind_gets_a_sentence(check, answer):
    verdict = check(answer)
    assert not verdict.solved and verdict.text.endswith(".") and "\n" not in verdict.text


def test_a_function_that_returns_something_else_gets_a_sentence():
    assert "two whole numbers" in check_rounding(lambda address, size: address).text
    assert "breaks off with ZeroDivisionError" in check_rounding(lambda address, size: (address // 0, size)).text


def test_exercise_3_cannot_be_talked_round():
    def off(cache, dma, buffer, frame):
        cache.disable()
        dma.write(buffer, frame)
        return cache.load(buffer, len(frame))

    assert not check_receive_driver(lambda cache, dma, buffer, frame: frame).solved
    assert "off" in check_receive_driver(off).text


@pytest.mark.parametrize(
    ("region", "complaint"),
    [
        (MpuRegion(1, 0x2002_4000, 16 * 1024, tex=1, c=0, b=0), None),
        (MpuRegion(1, 0x2002_4000, 16 * 1024, tex=1, c=0, b=0, s=1), None),
        (SOURCE1_MPU[0], "invalid client key"),
        (MpuRegion(1, 0x2002_4000, 16 * 1024, tex=0, c=0, b=0), "aligned"),
        (MpuRegion(1, 0x2002_0000, 32 * 1024, tex=1, c=0, b=0), "covers more"),
        (MpuRegion(1, 0x2002_4000, 8 * 1024, tex=1, c=0, b=0), "all of it"),
        (MpuRegion(1, 0x2002_4000, 16 * 1024, tex=0, c=1, b=0), "write-through"),
    ],
)
def test_exercise_4_asks_the_memory_map(region, complaint):
    verdict = check_region(region)
    assert verdict.solved if complaint is None else not verdict.solved and complaint in verdict.text


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 20), st.integers(0, 31))
def test_other_work_can_only_help_a_driver_that_does_not_clean(kib, offset):
    stale = [UrosSession(other_work=work, offset=offset).measure("stale bytes sent") for work in (0, kib)]
    assert stale[1] <= stale[0] == len(CREATE_CLIENT)
