"""Notebook 02: the published numbers, the cache map against the cache, the timing model against its equations, the exercises."""

import numpy as np
import pytest
from hypothesis import given, settings

from labkit.cache import Cache, Geometry, count, patterns, replay, stm32f767
from labkit.experiments.cache_patterns import (
    SHAPED_BY,
    SIZES,
    STRIDES,
    WAYS,
    CacheMap,
    MatrixOrders,
    MissRates,
    check_fifo_beats_lru,
    check_full_of_holes,
    check_good_order,
)
from labkit.experiments.cache_speedups import (
    CLAIMS,
    PublishedSpeedups,
    SpeedupGuess,
    change_of_one,
    check_idle_formula,
    check_sample_difference,
    check_wrong_total,
    measured_factor,
    recordings,
)
from labkit.experiments.cache_timing import CONTROL, JOBS, Explanations, TimingModel, check_coldest
from labkit.figures.cache_map import cache_map, sentence

# ------------------------------------------------------------------------------------------------------ what was measured


def test_all_eight_tables_are_read():
    tables = recordings()
    assert len(tables) == 8 and sum(map(len, tables.values())) == 68
    assert tables["FreeRTOS", "100|50", "on"]["wheel_ctrl"].mean == 10.69
    assert measured_factor("FreeRTOS", "wheel_ctrl", "100|50") == 37.77 / 10.69


def test_every_percentage_of_the_text_recomputes_but_the_idle_increase():
    experiment = PublishedSpeedups()
    metrics = experiment.metrics(experiment.run())
    claims = {m.name: m for m in metrics if m.published is not None}
    assert [m.name for m in claims.values() if not m.good] == ["IDLE, FreeRTOS"] and len(claims) == len(CLAIMS)
    assert claims["IDLE, FreeRTOS"].value == 17.48 and claims["IDLE, FreeRTOS"].published == 14.88
    assert metrics[0].text() == "7 of 8" and not metrics[0].good


def test_sums_change_otherwise_than_one_activation():
    rows = {row: round(change_of_one(*row), 2) for row in CLAIMS}
    assert [rows["micro-ROS", name] for name in ("odom", "p_ctrl", "w_ctrl")] == [-62.3, -76.69, -66.32]
    assert PublishedSpeedups().measure("largest gap to one activation") == pytest.approx(
        max(abs(rows[row] - printed) for row, printed in CLAIMS.items() if row[1] != "IDLE"), abs=0.011
    )


def test_the_picture_has_every_row_of_the_tables():
    result = PublishedSpeedups(quantity="share").run()
    assert {platform: len(pairs) for platform, pairs in result.items()} == {"micro-ROS": 20, "FreeRTOS": 14}
    shown = sorted(v for pairs in result.values() for p in pairs for v in (p.before, p.after))
    assert shown == sorted(row.share for rows in recordings().values() for row in rows.values())


def test_a_guess_is_judged_only_after_the_reveal():
    hidden, shown = SpeedupGuess(wheel_ctrl=3.5), SpeedupGuess(wheel_ctrl=3.5, reveal=True)
    assert {m.good for m in hidden.metrics(hidden.run())} == {None} == {m.published for m in hidden.metrics(hidden.run())}
    judged = {m.name: m for m in shown.metrics(shown.run())}
    assert judged["wheel ctrl"].good and not judged["odometry"].good and judged["link check"].good
    assert not hidden.figure(hidden.run())["data"][1]["x"] and len(shown.figure(shown.run())["data"][1]["x"]) == 10


# -------------------------------------------------------------------------------------------------------------- the cache


def test_the_sentence_says_what_the_access_did():
    own = "modify 0x20020000; read 0x20020100; read 0x20020200; read 0x20020100; read 0x20000000"
    history = CacheMap(pattern="own", own=own).run()
    columns = history.columns
    assert "empty" in sentence(columns, 0)
    assert "miss" in sentence(columns, 1) and "fills way 0" in sentence(columns, 1)
    assert "throws out line 0x20020000 and writes it back" in sentence(columns, 3)
    assert "hit" in sentence(columns, 4) and "past the cache" in sentence(columns, 5)
    drawn = cache_map(history, 5)["data"]
    marks = {t["name"]: list(t["x"]) for t in drawn if t["type"] == "scatter" and not t.get("showlegend", True)}
    assert (marks["miss"], marks["hit"], marks["past the cache"], marks["still to come"]) == ([1, 2, 3], [4], [5], [])


def test_a_click_on_an_access_goes_to_its_step_and_the_last_one_ends_the_play():
    history = CacheMap().run()
    for step in (0, 20, 36):
        figure = CacheMap(step=step).figure(history)
        assert figure["layout"]["meta"]["ended"] == (step == 36)
        assert figure["layout"]["meta"]["says"].startswith(f"Step {step} of 36" if step else "Nothing")
        for trace in figure["data"]:
            if "meta" in trace:
                assert trace["meta"]["set"] == [{"step": x} for x in list(trace["x"])]


@pytest.mark.parametrize("pattern", SHAPED_BY)
def test_greyed_is_what_does_not_shape_the_pattern(pattern):
    start = CacheMap(pattern=pattern, ways=1, step=300)
    moved = {"elements": 9, "stride": 64, "rounds": 2, "stores": True, "edge": 2, "own": "read 0x20020000", "policy": "fifo"}
    drawn = start.figure(start.run())

    def changes(name):
        other = start.replace(**{name: moved[name]})
        return repr(other.figure(other.run())) != repr(drawn)

    assert {name for name in moved if not changes(name)} == set(start.without_effect())


def test_a_step_of_the_map_is_a_view():
    assert CacheMap(step=3).same_run(CacheMap(step=30))
    history = CacheMap(step=3).run()
    assert CacheMap(step=30).metrics(history) == CacheMap(step=30).metrics(CacheMap(step=30).run())


def test_twelve_lines_in_room_for_eight_never_hit_and_eight_always_do():
    assert CacheMap(step=36).measure("misses so far") == 36
    assert CacheMap(step=24, elements=8).measure("misses so far") == 8


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("reed 0x20020000", "line 1: 'reed' is no command"),
        ("read 0x20020000 times 2000", "steps through 300 at most"),
        ("read 0x20020000 size 65536", "2048 accesses to a line; the map steps through 300 at most"),
        ("read 0x30000000", "0x30000000"),
        ("repeat 3; read 0x20020000", "repeat without an end"),
    ],
)
def test_a_bad_pattern_is_one_sentence(text, sentence):
    with pytest.raises(ValueError, match=sentence) as caught:
        CacheMap(pattern="own", own=text).run()
    assert "\n" not in str(caught.value)
    CacheMap(pattern="strided", own=text).run()  # a pattern that is not shown is not read


def test_miss_rates_are_those_of_the_records():
    experiment = MissRates(elements=24, stride=128, size=1024, ways=2, order="shuffled", policy="fifo")
    references = experiment.references(128)
    records = replay(references, Cache(stm32f767(), Geometry(1024, 2, 32), "fifo"))
    result = experiment.run()
    assert result["size"][SIZES.index(1024)] == result["ways"][WAYS.index(2)] == result["stride"][STRIDES.index(128)]
    assert experiment.measure("misses") == 100 * sum(not r.hit for r in records) / len(records)


def test_a_round_visits_every_element_once_in_every_order():
    for order in ("circle", "back and forth", "shuffled"):
        rounds = MissRates(elements=16, order=order).references(64).address.reshape(4, -1)
        assert all(sorted(r) == sorted(rounds[0]) for r in rounds.tolist())
    assert (
        MissRates(order="back and forth", elements=256, size=4096).measure("misses")
        < MissRates(elements=256, size=4096).measure("misses")
        == 100
    )


def test_loop_orders_count_the_misses_of_the_product():
    result = MatrixOrders(n=8, size=512, ways=2, tile=4).run()
    for order, misses in result.items():
        assert misses.total == count(patterns.matrix_product(8, order=order, tile=4), Geometry(512, 2, 32))["fills"]
        assert misses.compulsory == 3 * 8 * 8 * 4 // 32
    assert MatrixOrders(ways=1).run()["jki"].conflict < 0


# -------------------------------------------------------------------------------------------------------------- the timing


def test_the_timing_model_is_its_two_equations():
    model = TimingModel(coldness=50, passes=2, overhead=1, uncached_data=5, data_fill=20, per_instruction=0.8, insensitive=50)
    off, on = model.run()
    n, fetches, data, read = 100_000, 48_000, 30_000, 1 + 7 + 1
    assert off.total == 0.8 * n * 1.5 + fetches * read + data * 5
    assert on.total == pytest.approx(0.8 * n * 1.5 + 0.25 * fetches / 4 * (read + 3) + 0.25 * data / 8 * 20, abs=30)
    assert model.measure("speed-up") == off.total / on.total


@settings(max_examples=60, deadline=None)
@given(Explanations.strategy())
def test_an_explanation_fits_both_times_exactly_or_is_refused(experiment):
    result = experiment.run()
    possible = result.balance >= 0
    fits = all(abs(cost.total - target) / JOBS < 0.1 for cost, target in zip((result.off, result.on), result.target, strict=True))
    assert possible == fits or abs(result.balance) / JOBS < 0.1
    assert experiment.measure("explains both times") == possible


@pytest.mark.parametrize("task", CONTROL)
def test_the_slopes_over_the_wait_states_are_fetches_and_fills(task):
    result = Explanations(task=task, coldness=30).run()
    states, off, on = np.array(result.slopes).T
    assert states.tolist() == list(range(8))
    assert np.polyfit(states, off, 1)[0] == pytest.approx(result.work.fetches / JOBS)
    assert np.polyfit(states, on, 1)[0] == pytest.approx(result.work.code_fills / JOBS)
    assert off[-1] == pytest.approx(result.target[0] / JOBS, abs=0.1) and on[-1] == pytest.approx(
        result.target[1] / JOBS, abs=0.1
    )


def test_two_explanations_of_one_measurement_differ_at_another_clock():
    warm, cold = (Explanations(coldness=c).run() for c in (0, 50))
    assert warm.slopes[-1][1:] == pytest.approx(cold.slopes[-1][1:], abs=0.1)
    assert warm.slopes[0][1] - cold.slopes[0][1] > 200


# -------------------------------------------------------------------------------------------------------------- exercises


def test_clues_ask_the_tables():
    assert [t for t in range(12) if check_wrong_total(t).solved] == [9]
    assert check_idle_formula(lambda off, on: 100 * (on - off) / on).solved
    assert not check_idle_formula(lambda off, on: 100 * (on - off) / off).solved
    for answer in (14.88, lambda off, on: 14.88, lambda off, on: "14.88 %", lambda off: off, lambda off, on: off / 0, None):
        assert not check_idle_formula(answer).solved
    for answer in ("9", "table 9", None, [9], 9.0, True):
        assert "the number of a table" in check_wrong_total(answer).text
    pairs = [(p, r) for p in ("micro-ROS", "FreeRTOS", "ROS") for r in ("50|30", "100|50", "1")]
    assert [pair for pair in pairs if check_sample_difference(*pair).solved] == [("micro-ROS", "50|30")]


def test_exercises_ask_the_model():
    assert check_full_of_holes(MissRates(elements=8, stride=4096)).solved
    assert not check_full_of_holes(MissRates(elements=8, stride=2048)).solved
    assert not check_full_of_holes(MissRates(elements=256, stride=4096)).solved
    assert not check_full_of_holes(MissRates(elements=8, stride=4096, ways=1)).solved
    assert check_fifo_beats_lru("read 0x20020000 times 4 step 32; read 0x20020000; read 0x20020080; read 0x20020020").solved
    assert not check_fifo_beats_lru("read 0x20020000 times 12 step 32").solved
    assert not check_fifo_beats_lru("read 0x20020000 times 13 step 32").solved
    assert "no command" in check_fifo_beats_lru("rid 0").text
    assert check_good_order(MatrixOrders(order="kij", tile=8)).solved
    assert not check_good_order(MatrixOrders(order="ikj")).solved
    assert not check_good_order(MatrixOrders(order="kij", tile=8, size=8192)).solved


def test_exactly_one_coldness_is_the_coldest():
    assert sum(check_coldest(Explanations(task="pose_control", coldness=c)).solved for c in range(101)) == 1


@pytest.mark.parametrize("check", [check_full_of_holes, check_fifo_beats_lru, check_good_order, check_coldest])
@pytest.mark.parametrize("answer", [None, 65, 0.65, "65 %", "MissRates(elements=8)", CacheMap(), lambda: 65])
def test_an_answer_of_another_kind_gets_a_sentence(check, answer):
    verdict = check(answer)
    assert not verdict.solved and verdict.text.endswith(".")


@pytest.mark.parametrize("moved", [{"task": "odometry"}, {"overhead": 0}, {"per_instruction": 0.5}])
def test_the_coldest_is_asked_at_the_prices_of_the_bench(moved):
    verdict = check_coldest(Explanations(**{"task": "pose_control", "coldness": 65} | moved))
    assert not verdict.solved and "move coldness only" in verdict.text


def test_the_solution_printed_in_the_notebook_is_one():
    assert check_coldest(Explanations(task="pose_control", coldness=65)).solved
