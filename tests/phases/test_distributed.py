"""Several stations on one radio: equal windows at the same time, data of all at the begin of fusion, and what is incoherent."""

import numpy as np
import pytest

from labkit.network import Group, GroupMail, Independent, Plan, period_starts
from labkit.phases import MS, CommunicationUnit, DataObject, FusionUnit, Organiser, Team, Unit, laser_team


@pytest.fixture(scope="module")
def experiment_1():
    """Two stations, 400 periods, as source 2 has them; clocks 2.14 ppm apart."""
    return laser_team(2, 400)


def test_together_equal_windows_are_at_the_same_time(experiment_1):
    overlap = experiment_1.team.overlap()
    assert overlap.shape == (400, 8)
    assert overlap.min() > 0.99 and overlap.mean() > 0.998


def test_no_deadline_is_missed_and_the_contour_filter_is_aborted(experiment_1):
    assert experiment_1.missed == 0
    for organiser in experiment_1.team.organisers:
        aborted = [a for a in organiser.activations if a.aborted]
        assert {a.unit for a in aborted} == {"LMSContourFilter"} and 40 < len(aborted) < 200
        assert all(sum(a.period == p for a in organiser.activations) == 8 for p in (0, 399))


def test_data_of_both_are_there_at_the_begin_of_each_fusion_and_coherent(experiment_1):
    assert experiment_1.bound_ns <= experiment_1.window_ns
    assert len(experiment_1.apart_ns) == 800 and experiment_1.apart_ns.min() >= 0
    assert experiment_1.coherent(14 * MS) == 1
    assert experiment_1.coherent(5 * MS) < 0.95, "a threshold below the wait for the mirror (5.1) is too small"


def test_the_same_by_brute_force_of_the_record(experiment_1):
    for fused in experiment_1.team.fused[:200]:
        mine, other = fused.stamps[fused.station], fused.stamps[1 - fused.station]
        assert 0 < fused.begin_ns - mine < 100 * MS and 0 < fused.begin_ns - other < 100 * MS


def test_without_synchronisation_the_share_follows_the_phase():
    apart = {}
    for offset in (0, 20, 50):
        found = laser_team(2, 30, "none", 0, offset * MS, mirror_ns=0, reading_ns=0)
        apart[offset] = found.apart_ns[2:]  # the first fusion may come before the first message
    assert apart[0].max() < MS
    assert set(np.round(apart[20] / MS).astype(int)) <= {20, 80, 120} and apart[20].min() >= 19 * MS
    assert apart[50].min() >= 49 * MS


def test_absolute_correction_brings_a_late_station_in_and_differences_do_not():
    brought, kept = (laser_team(2, 40, kind, 2.14, 20 * MS, mirror_ns=0) for kind in ("absolute", "differences"))
    assert brought.apart_ns[-4:].max() < MS
    assert kept.apart_ns[-4:].min() > 10 * MS


def test_losses_leave_old_data_and_a_larger_degree_helps():
    few, many = (laser_team(2, 40, loss=Independent(0.2), omission_degree=degree) for degree in (1, 2))
    assert many.coherent(14 * MS) > few.coherent(14 * MS)
    assert few.apart_ns.max() > 80 * MS


def test_a_radio_that_loses_everything_leaves_each_with_its_own():
    found = laser_team(2, 10, loss=Independent(1.0))
    assert set(found.apart_ns.tolist()) == {-1} and found.missed == 0


def small_team(stations: int = 3, periods: int = 4, skip: frozenset[str] = frozenset(), double: bool = True):
    """A chain of four units in 40 ms, whose fusion counts what it has."""
    organisers, seen = [], []
    for _ in range(stations):
        doubling = Unit("double")

        @doubling.part(ecet_ns=MS, wcet_ep_ns=MS // 10)
        def main(data):
            yield MS // 2, DataObject(data.station, data.timestamp_ns, data.payload * 2)

        @doubling.last_action
        def publish(unit, results):
            unit.make_output_available(results["main"])

        comm = CommunicationUnit("send", 20 * MS, MS // 10)
        fusion = FusionUnit("fuse", comm, lambda objects: {n: item.payload for n, item in objects.items()}, MS, MS // 10)
        last = Unit("show")

        @last.part(ecet_ns=MS, wcet_ep_ns=MS // 10)
        def show(data):
            seen.append(data)
            yield 1000, data

        organisers.append(Organiser([doubling, comm, fusion, last], 40 * MS, 2 * MS))
    plan = Plan(40 * MS)
    starts = period_starts(plan, "none", np.zeros(stations, int), np.zeros((periods, stations), int))
    team = Team(organisers, starts, skip)
    mail = GroupMail(Group(stations, 1), 100, 6 * MS, team.deliver)
    team.run(mail, lambda station, period, now: DataObject(station, now, bytes([65 + station])))
    return team, mail, seen


def test_three_stations_read_all_objects_and_write_number_0():
    team, mail, seen = small_team()
    assert mail.bound_ns == 6 * 6 * MS
    assert seen[-1] == {1: b"AA", 2: b"BB", 3: b"CC"}
    fusion = team.organisers[2].units[2]
    assert fusion.objects[0] == seen[-1] and set(fusion.objects) == {0, 1, 2, 3}
    assert [f.apart_ns(3) for f in team.fused[-3:]] == [0, 0, 0]


def test_a_skipped_stage_hands_its_input_on():
    _, _, seen = small_team(skip=frozenset({"double"}))
    assert seen[-1] == {1: b"A", 2: b"B", 3: b"C"}
    team, _, seen = small_team(skip=frozenset({"fuse"}))
    assert team.fused == [] and isinstance(seen[-1], DataObject)
    assert {a.unit for a in team.organisers[0].activations} == {"double", "send", "show"}


def test_data_can_be_requested_again():
    team, mail, _ = small_team(stations=2)
    comms = [organiser.units[1] for organiser in team.organisers]
    comms[0].arrived.clear()
    comms[0].request_data(1)
    mail.run(40 * MS * 8)
    assert comms[0].arrived[1].payload == b"BB"


def test_what_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="no unit 'fly' to skip; there are double, fuse"):
        small_team(skip=frozenset({"fly"}))
    with pytest.raises(ValueError, match="number of stations is 1"):
        laser_team(1)
    with pytest.raises(ValueError, match="number of periods is 0"):
        laser_team(2, 0)
    with pytest.raises(ValueError, match="101 bytes; at most 100"):
        GroupMail(Group(2, 1), 100, MS, lambda *_: None).send(0, bytes(101))
