"""Notebook 00: its two benches and its exercises."""

import pytest

from labkit.data import example
from labkit.experiments.own_recording import LONGEST, OwnRecording
from labkit.experiments.start_here import ThreeTasks, check_most_work, check_most_work_at_30
from labkit.trace import LogError, describe, read_recording, statistics

TOLD = {"board.log": "log", "board.btf": "BTF", "linux_ftrace.txt": "ftrace", "run.csv": "lab CSV", "run.json": "lab JSON"}


def test_the_time_looked_at_is_told():
    start = ThreeTasks(at=8.5)
    says = start.figure(start.run())["layout"]["meta"]["says"]
    assert says == "At 8.5 ms: pose_ctrl runs."


def test_the_exercises_have_one_answer_each():
    works = [n / 2 for n in range(1, 80)]
    assert [w for w in works if check_most_work(ThreeTasks(pose_work=w)).solved] == [18]
    assert [w for w in works if check_most_work_at_30(ThreeTasks(pose_period=30, pose_work=w)).solved] == [11]


@pytest.mark.parametrize("answer", [18, "18 ms", "ThreeTasks(pose_work=18)", ThreeTasks, OwnRecording(), None])
def test_an_answer_of_another_kind_gets_a_sentence(answer):
    feedback = check_most_work(answer)
    assert not feedback.solved and "it has to be a setting of the bench" in feedback.text


def test_what_is_not_the_readers_to_move_is_named():
    feedback = check_most_work(ThreeTasks(pose_work=18, wheel_work=0.5, odometry_work=4.5))
    assert not feedback.solved and feedback.text == "move pose_work only; leave wheel_work=3.0, odometry_work=5.0."


def bars(recording):
    """(start, length) of each run that is drawn, in ms."""
    drawn = next(t for t in recording.figure(recording.run())["data"] if t["type"] == "bar" and len(t["x"]))
    return sorted((round(at, 3), round(wide, 3)) for at, wide in zip(drawn["base"], drawn["x"], strict=True))


def test_the_excerpt_is_drawn_as_it_was_logged():
    excerpt = OwnRecording()
    result = excerpt.run()
    assert bars(excerpt) == [(0.001, 0.026), (0.028, 0.303), (0.332, 0.003), (7.412, 0.091), (7.95, 0.018)]
    assert result.says().startswith("xu2025_trace_unordered.log, read as log: 11 lines, 5 out of order, 1 repaired, 0 left out.")


@pytest.mark.parametrize("name", TOLD)
def test_every_sample_recording_shows_the_same_tasks(name):
    recording = OwnRecording(file=str(example(name)))
    result = recording.run()
    assert {task.split("-")[0] for task in result.ran} == {"ctl", "odom", "logger"}
    assert f"read as {TOLD[name]}:" in result.says()
    trace, _ = read_recording(example(name))
    assert "ctl" in describe(statistics(trace))
    reference = OwnRecording(file=str(example("run.csv"))).run()
    for (task, ran), (other, wanted) in zip(sorted(result.ran.items()), sorted(reference.ran.items()), strict=True):
        assert task.startswith(other) and ran == pytest.approx(wanted, abs=4.0)  # the recordings are cut at different ends


def test_a_window_shows_only_what_is_in_it():
    recording = OwnRecording(file=str(example("board.log")), start=50, end=60)
    axis = recording.figure(recording.run())["layout"]["xaxis"]
    assert axis["range"] == [50, 60]
    whole, part = (bars(each) for each in (recording.replace(start=0, end=LONGEST), recording))
    inside = [(at, at + wide) for at, wide in whole if at < 60 and at + wide > 50]
    assert inside and [bar for bar in ((at, at + wide) for at, wide in part) if bar[0] < 60 and bar[1] > 50] == inside
    beyond = recording.replace(start=LONGEST)
    low, high = beyond.figure(beyond.run())["layout"]["xaxis"]["range"]
    assert low < high <= beyond.run().length


def test_what_was_found_is_told_and_a_zoom_that_ends_early_too(tmp_path):
    (tmp_path / "long.log").write_text(
        "a 0 1\na 400000000 0\nnoise\na 899000000 1\na 899000001 0\na 900000500 1\na 900001000 0\n"
    )
    long = OwnRecording(file=str(tmp_path / "long.log"))
    meta = long.figure(long.run())["layout"]["meta"]
    assert (
        meta["says"].endswith("Zoom reaches its first 15 minutes.") and "long.log: 7 lines, 6 stamps, 1 rejected" in meta["told"]
    )
    assert "line 3: " in meta["told"] and "count" in meta["told"] and str(tmp_path) not in meta["told"]
    assert "Zoom" not in OwnRecording().run().says()


@pytest.mark.parametrize("file", ["no such file", ".", "\0"])
def test_a_file_that_cannot_be_read_is_a_sentence(file):
    with pytest.raises(LogError, match="cannot be read"):
        OwnRecording(file=file).run()
