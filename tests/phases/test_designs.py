"""Windows to the nanosecond, the six designs against the guarantees the source gives each, and its first experiment."""

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.phases import Part, check_windows, read_chain, windows
from labkit.phases.designs import DESIGNS, guarantees, phase_times, run_design, run_designs
from labkit.phases.laser_chain import CONTOUR, MS, PERIOD_NS, RESERVE_NS, contour_model, experiment_1, laser_chain, laser_load
from labkit.trace import slices
from labkit.trace.kinds import KINDS

PUBLISHED = Path(__file__).parents[2] / "data" / "diplom_table5_windows.csv"


def chain(*rows):
    """(ECET, EP[, WCET]) rows as phases p0, p1, ... of one part each; a list of rows is one phase of several parts."""
    made = []
    for i, row in enumerate(rows):
        parts = row if isinstance(row, list) else [row]
        made += [Part(f"p{i}", f"p{i}" if len(parts) == 1 else f"s{j}", *part) for j, part in enumerate(parts)]
    return made


# ------------------------------------------------------------------------------------------------------- windows


def test_table_5_to_the_nanosecond_with_its_swapped_digits():
    with PUBLISHED.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    made = windows(laser_chain(), PERIOD_NS, RESERVE_NS)
    assert [w.phase for w in made] == [row["phase"] for row in rows[:-1]]
    wrong = {"LMSCommunication": 63}  # 36 554 792 is printed for 36 554 729
    assert [int(row["deadline_ns"]) - w.deadline_ns for row, w in zip(rows, made)] == [wrong.get(w.phase, 0) for w in made]
    from_start = [int(row["deadline_from_period_start_ns"]) - w.end_ns for row, w in zip(rows, made)]
    assert from_start == [0, 0, 63, 63, 63, 63, 63, 0]
    assert made[-1].end_ns + RESERVE_NS == PERIOD_NS


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.lists(st.tuples(st.integers(1, 10**9), st.integers(0, 10**8)), min_size=1, max_size=3), min_size=1, max_size=9),
    st.integers(0, 10**9),
    st.integers(0, 10**9),
)
def test_windows_share_the_period_fairly_and_lose_no_nanosecond(rows, spare, reserve):
    parts = chain(*rows)
    room = sum(part.demand_ns for part in parts) + spare
    made = windows(parts, room + reserve, reserve)
    assert made[0].release_ns == 0 and made[-1].end_ns == room
    assert all(a.end_ns == b.release_ns for a, b in pairwise(made))
    total = sum(w.demand_ns for w in made)
    for w in made:
        assert w.spare_ns >= 0  # (4.17)
        assert abs(w.deadline_ns * total - room * w.demand_ns) < total  # within 1 ns of (4.18)
    check_windows(parts, [(w.phase, w.release_ns, w.deadline_ns) for w in made], room + reserve, reserve)


def test_a_period_too_short_says_by_how_much_and_where():
    with pytest.raises(
        ValueError,
        match=r"^phase 'LMSElementFusion' does not fit: the period of 90000000 ns less the reserve of 2000000 ns is 6100000 ns",
    ):
        windows(laser_chain(), 90 * MS, 2 * MS)
    with pytest.raises(
        ValueError, match=r"is 1 ns too short .* the expected times alone, 93000000 ns, would fit, the exception parts do not$"
    ):
        windows(laser_chain(), 96_099_999, 2 * MS)
    assert windows(laser_chain(), 96_100_000, 2 * MS)[3].spare_ns == 0
    with pytest.raises(ValueError, match="the chain is empty"):
        windows([], 100)


@pytest.mark.parametrize(
    ("manual", "message"),
    [
        ([("p0", 0, 11), ("p1", 10, 10)], "the window of phase 'p0' overlaps that of 'p1' by 1 ns"),
        ([("p0", 0, 10), ("p1", 10, 12)], "the window of phase 'p1' ends 2 ns after the period"),
        ([("p0", 0, 4), ("p1", 4, 16)], "the window of phase 'p0' is 2 ns too short for its 6 ns"),
        ([("p1", 0, 10), ("p0", 10, 10)], "in order, for p0, p1"),
        ([("p0", -1, 10), ("p1", 10, 10)], "the release of phase 'p0' in ns is -1; a whole number of at least 0 is allowed"),
    ],
)
def test_windows_by_hand_are_checked(manual, message):
    with pytest.raises(ValueError, match=message):
        check_windows(chain((5, 1), (5, 1)), manual, 20)


def test_parts_and_chains_that_make_no_sense():
    with pytest.raises(ValueError, match="phase 'a', part 'a': the expected time 9 ns exceeds the worst case 8 ns by 1 ns"):
        Part("a", "a", 9, 1, 8)
    with pytest.raises(ValueError, match="phase 'a', part 'a': ecet_ns is 0; a whole number of at least 1 is allowed"):
        Part("a", "a", 0, 1)
    with pytest.raises(ValueError, match=r"phase 'a', part 'a': wcet_ns is 2.5; a whole number of at least 1 is allowed"):
        Part("a", "a", 1, 1, 2.5)
    with pytest.raises(ValueError, match="phase 'a' comes twice"):
        windows([Part("a", "a", 1, 1), Part("b", "b", 1, 1), Part("a", "c", 1, 1)], 100)
    with pytest.raises(ValueError, match="phase 'a' has two parts called 'a'"):
        windows([Part("a", "a", 1, 1), Part("a", "a", 1, 1)], 100)


def test_a_chain_is_read_from_csv(tmp_path):
    file = tmp_path / "chain.csv"
    file.write_text(
        "phase,part,ecet_ns,wcet_ep_ns\nscan,,4000000,100000\nfilter,arcs,30000000,200000\nfilter,edges,4000000,200000\n"
    )
    assert read_chain(file) == [
        Part("scan", "scan", 4_000_000, 100_000),
        Part("filter", "arcs", 30_000_000, 200_000),
        Part("filter", "edges", 4_000_000, 200_000),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase,part,ecet_ns\nscan,,4\n", "no column wcet_ep_ns"),
        ("phase,part,ecet_ns,wcet_ep_ns\n", "the chain is empty"),
        (
            "phase,part,ecet_ns,wcet_ep_ns\nscan,,4.5,1\n",
            "line 2: ecet_ns is '4.5'; a whole number from 1 to 1000000000000000000 is allowed",
        ),
        ("phase,part,ecet_ns,wcet_ep_ns\nscan,,4,\n", "line 2: the part has no wcet_ep_ns; a whole number from 0"),
        (
            "phase,part,ecet_ns,wcet_ep_ns\n,,4,1\n",
            "line 2: the part has no phase; a text of 1 to 100 printable characters is needed",
        ),
        ("phase,part,ecet_ns,wcet_ep_ns\nscan,,4,-1\n", "wcet_ep_ns is -1"),
        ("phase,part,ecet_ns,wcet_ep_ns\nscan\n", "line 2: the part has no ecet_ns"),
        ('phase,part,ecet_ns,wcet_ep_ns\n"a\nb",,4,1\n', r"line 3: phase is 'a\nb'; a text of 1 to 100 printable characters"),
        ("phase,part,ecet_ns,wcet_ep_ns\nscan,,4,1" + "0" * 5000, "line 2: wcet_ep_ns is '10000000"),
        (
            "phase,part,ecet_ns,wcet_ep_ns\nscan,,4,1" + "0" * 18 + "1",
            "line 2: wcet_ep_ns is 10000000000000000001; a whole number",
        ),
        ("phase,part,ecet_ns,wcet_ep_ns\nscan," + "x" * 200_000, "line 2: field larger than field limit"),
        ("phase,part,ecet_ns,wcet_ep_ns,ecet_ns\nscan,,4,1,5\n", "line 1: more than one column ecet_ns"),
        ("phase,part,ecet_ns,wcet_ep_ns\n" + "a,,4,1\nb,,4,1\n" * 501, "the chain has more parts than 1000"),
        ("", "no column phase"),
    ],
)
def test_bad_chains_name_the_line(tmp_path, text, message):
    file = tmp_path / "chain.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        read_chain(file)
    assert message in str(error.value)


# ------------------------------------------------------------------------------------------------------- designs


CHAIN = chain((10, 1, 20), [(20, 1, 60), (5, 1, 10)], (10, 1, 25))


def load_of(parts, periods, seed):
    rng = np.random.default_rng(seed)
    return np.stack([rng.integers(1, part.wcet_ns + 1, periods) for part in parts], axis=1)


def kept(run):
    return "".join(g.name[1] for g in run.guarantees if g.kept)


def test_the_designs_give_the_guarantees_the_source_says():
    runs = {run.design: run for run in run_designs(CHAIN, load_of(CHAIN, 300, 2), 70)}
    assert {name: bool(run.verdict) for name, run in runs.items()} == {
        "edf thread": False,
        "taft thread": True,
        "taft thread, wcet": False,
        "taft phases": True,
        "taft releases": True,
        "taft windows": True,
    }
    assert kept(runs["taft thread"]) == "124"
    assert kept(runs["taft phases"]) == "123"
    assert kept(runs["taft windows"]) == "1234"
    assert "4" not in kept(runs["taft releases"]) and "3" in kept(runs["taft releases"])
    assert "2" not in kept(runs["edf thread"])
    broken = next(g for g in runs["taft phases"].guarantees if not g.kept)
    assert (
        broken.phase == CHAIN[1].name
        and broken.why == f"period {broken.period}: phase p1.s0 begins before an earlier phase has ended"
    )


def test_with_room_for_the_worst_cases_a_thread_gives_all_and_expected_times_give_it_to_the_thread_too():
    runs = {run.design: run for run in run_designs(CHAIN, load_of(CHAIN, 200, 3), 120)}
    for name in ("edf thread", "taft thread, wcet", "taft windows"):
        assert runs[name].verdict and kept(runs[name]) == "1234"


def test_order_holds_with_releases_while_nobody_exceeds_its_ecet():
    load = np.minimum(load_of(CHAIN, 200, 4), [part.ecet_ns for part in CHAIN])
    assert kept(run_design(CHAIN, "taft releases", load, 70)) == "1234"


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(49, 130), st.integers(0, 10))
def test_windows_keep_all_guarantees_under_any_load(seed, period, reserve):
    run = run_design(CHAIN, "taft windows", load_of(CHAIN, 30, seed), period + reserve, reserve)
    assert run.verdict and kept(run) == "1234"
    times = phase_times(run.trace, len(CHAIN), 30, period + reserve)
    assert (times.end >= 0).all() and (times.end <= (np.arange(30)[:, None] + 1) * (period + reserve) - reserve).all()
    fell = times.aborted >= 0
    assert (times.main[fell] >= np.broadcast_to([p.ecet_ns for p in CHAIN], fell.shape)[fell]).all()
    assert (times.exception == fell * [p.wcet_ep_ns for p in CHAIN]).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(DESIGNS), st.integers(49, 130))
def test_no_load_crashes_a_design_and_time_is_conserved(seed, design, period):
    load = load_of(CHAIN, 12, seed)
    run = run_design(CHAIN, design, load, period)
    times = phase_times(run.trace, len(CHAIN), 12, period)
    assert (times.main <= load).all()
    complete = (times.end >= 0) & (times.aborted < 0) & (times.end <= times.release + period)
    assert (times.main[complete] == load[complete]).all()


def one_by_one(trace, parts, periods, period_ns):
    """What `phase_times` tells, row by row and slice by slice."""
    told = {name: np.full((periods, parts), -1) for name in ("release", "start", "end", "aborted")}
    told |= {name: np.zeros((periods, parts), int) for name in ("main", "exception")}
    events = [row for row in trace.rows("release", "complete", "abort").tolist() if row[5] < periods]
    for time, kind, who, _, value, job in events:
        name = {"release": "release", "complete": "end", "abort": "aborted"}[KINDS[kind]]
        told[name][job, who % parts] = value if name == "release" else time
    for who, part, job, begin, finish in slices(trace).rows().tolist():
        if job < periods:
            limit = told["release"][job, who] + period_ns
            told["exception" if part else "main"][job, who] += max(0, min(finish, limit) - begin)
            if not part and told["start"][job, who] < 0:
                told["start"][job, who] = begin
    for time, kind, who, _, _, job in events:
        if KINDS[kind] == "abort" and told["start"][job, who] < 0:
            told["start"][job, who] = time
    return told


def by_hand(told, chain, load, period):
    """The guarantees that a run keeps, from their definitions, period by period and part by part."""
    kept = {1, 2, 3, 4}
    phase = [part.phase for part in chain]
    for k in range(len(load)):
        start, end = told["start"][k], told["end"][k]
        for i, part in enumerate(chain):
            begun = start[i] >= 0
            if phase[i] == phase[0] and not (begun and k * period <= start[i] < (k + 1) * period):
                kept.discard(1)
            if begun and not 0 <= end[i] <= (k + 1) * period:
                kept.discard(2)
            if told["main"][k, i] < min(load[k, i], part.ecet_ns):
                kept.discard(3)
            for j in range(i):
                if phase[j] != phase[i] and begun and start[j] >= 0 and not 0 <= end[j] <= start[i]:
                    kept.discard(4)
    return "".join(str(g) for g in sorted(kept))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(st.integers(1, 12), st.integers(0, 3), st.integers(0, 30)), min_size=1, max_size=3),
        min_size=1,
        max_size=5,
    ),
    st.integers(0, 20),
    st.integers(0, 10**6),
    st.sampled_from(DESIGNS),
)
def test_random_chains_are_judged_as_by_hand(rows, spare, seed, design):
    parts = chain(*[[(ecet, ep, ecet + more) for ecet, ep, more in phase] for phase in rows])
    period, load = sum(part.demand_ns for part in parts) + spare, load_of(parts, 8, seed)
    run = run_design(parts, design, load, period)
    told = one_by_one(run.trace, len(parts), 8, period)
    for name, table in told.items():
        np.testing.assert_array_equal(getattr(run.times, name), table, err_msg=name)
    assert kept(run) == by_hand(told, parts, load, period)
    if design == "taft windows":
        assert kept(run) == "1234"


def test_each_guarantee_can_be_seen_broken():
    """The judge itself: a run judged against a load or a period that it did not have."""
    load = load_of(CHAIN, 20, 1)
    good = run_design(CHAIN, "taft windows", load, 70).trace

    def judged(trace, period, chain=CHAIN):
        return guarantees(phase_times(trace, len(chain), len(load), period), chain, load, period)

    assert all(g.kept for g in judged(good, 70))
    assert {g.name for g in judged(good, 35) if not g.kept} >= {"G1", "G2"}
    reversed_chain = [*CHAIN[1:3], CHAIN[0], CHAIN[3]]
    assert "G4" in {g.name for g in judged(run_design(CHAIN, "taft thread", load, 120).trace, 120)}
    assert not judged(run_design(reversed_chain, "taft phases", load, 70).trace, 70)[3].kept


def test_bad_designs_and_loads():
    with pytest.raises(ValueError, match="design 'x'; there are edf thread"):
        run_design(CHAIN, "x", load_of(CHAIN, 3, 1), 70)
    with pytest.raises(ValueError, match=r"a load of shape \(3, 2\)"):
        run_design(CHAIN, "taft windows", np.ones((3, 2), int), 70)
    with pytest.raises(ValueError, match="phase 'p2' does not fit"):
        run_design(CHAIN, "taft windows", load_of(CHAIN, 3, 1), 48)


# --------------------------------------------------------------------------------------------------- experiment 1


def test_experiment_1_misses_nothing_and_aborts_the_contour_filter_only():
    e = experiment_1()
    assert (e.missed, e.other_aborts, len(e.load)) == (0, 0, 400)
    assert all(g.kept for g in e.run.guarantees)
    assert 84 <= e.aborted_periods <= 124


def test_how_the_abort_count_depends_on_what_the_source_leaves_open():
    def mean(**more):
        return np.mean([experiment_1(seed=seed, **more).aborted_periods for seed in range(3)])

    few, usual, many = (mean(contour=contour_model(runs)) for runs in (200, 1000, 10_000))
    assert few < usual < many and few < 121 < many + 15
    assert mean(reprocess=False) == pytest.approx(usual / 2)
    assert mean(arcs_ecet_ns=20 * MS) > usual


def test_the_load_has_what_is_published():
    load = laser_load(laser_chain(), 40_000, contour_model(), True, 3)
    contour = load[:, [part.phase == CONTOUR for part in laser_chain()]].sum(axis=1)
    assert np.array_equal(contour[::2], contour[1::2])
    assert np.mean(contour < 50 * MS) == pytest.approx(0.9, abs=0.01)
    assert contour.max() <= 140 * MS + 1
