"""Recordings of other tools: hand-made ones whose running times were added up by hand, published excerpts, and damage."""

import importlib.util
import io
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.kernel import Costs, Kernel
from labkit.scheduler import schedule
from labkit.trace import LogError, export_chrome, export_csv, export_npz, jobs, read_log, read_recording, spans, statistics
from labkit.trace.readers import chrome as chrome_


def running(trace):
    """Running time in us of each task that ran; on several cores, of each task and core."""
    return {name: round(time, 6) for name, time in statistics(trace)["self"].items() if time}


def accounts_for_every_line(report):
    return report.lines == report.stamps + report.skipped + report.rejected + report.comments + report.empty


# ftrace ---------------------------------------------------------------------------------------------------------------------

#: Ten milliseconds of a control loop (pid 10), an interrupt thread (11) that preempts it, and a logger (12) on the other core.
#: ctl: 100.000005 to .001005 and .001105 to .002005, again .010020 to .010520: 1000 + 900 + 500 = 2400 us; irq: 100 us;
#: logger on core 1: .000500 to .003000 = 2500 us.
KERNEL_STYLE = """\
# tracer: nop
#
# entries-in-buffer/entries-written: 9/9   #P:2
#
#           TASK-PID     CPU#  |||||  TIMESTAMP  FUNCTION
#              | |         |   |||||     |         |
          <idle>-0       [000] d..2.   100.000000: sched_wakeup: comm=ctl pid=10 prio=50 target_cpu=000
          <idle>-0       [000] d..2.   100.000005: sched_switch: prev_comm=swapper/0 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=ctl next_pid=10 next_prio=50
          <idle>-0       [001] d..2.   100.000500: sched_switch: prev_comm=swapper/1 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=log: a b next_pid=12 next_prio=120
             ctl-10      [000] d..2.   100.001005: sched_switch: prev_comm=ctl prev_pid=10 prev_prio=50 prev_state=R+ ==> next_comm=irq/5 next_pid=11 next_prio=10
             ctl-10      [000] d.h1.   100.001050: irq_handler_entry: irq=5 name=spi
           irq/5-11      [000] d..2.   100.001105: sched_switch: prev_comm=irq/5 prev_pid=11 prev_prio=10 prev_state=S ==> next_comm=ctl next_pid=10 next_prio=50
             ctl-10      [000] d..2.   100.002005: sched_switch: prev_comm=ctl prev_pid=10 prev_prio=50 prev_state=S ==> next_comm=swapper/0 next_pid=0 next_prio=120
        log: a b-12      [001] d..2.   100.003000: sched_switch: prev_comm=log: a b prev_pid=12 prev_prio=120 prev_state=D ==> next_comm=swapper/1 next_pid=0 next_prio=120
          <idle>-0       [000] d..2.   100.010000: sched_wakeup: comm=ctl pid=10 prio=50 target_cpu=000
          <idle>-0       [000] d..2.   100.010020: sched_switch: prev_comm=swapper/0 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=ctl next_pid=10 next_prio=50
             ctl-10      [000] d..2.   100.010520: sched_switch: prev_comm=ctl prev_pid=10 prev_prio=50 prev_state=S ==> next_comm=swapper/0 next_pid=0 next_prio=120
"""  # noqa: E501
RUNNING = {("log: a b-12", 1): 2500.0, ("ctl-10", 0): 2400.0, ("irq/5-11", 0): 100.0}


def short_style(text):
    """The same events as trace-cmd reports them, core and flags in one."""
    made = ["cpus=2", "CPU 1 is empty"]
    for line in text.splitlines():
        if "sched_switch" in line:
            head, rest = line.split(": sched_switch: ")
            words = dict(zip(("before", "after"), rest.split(" ==> ")))
            who = {}
            for key, word in words.items():
                comm, _, more = (
                    word.removeprefix("prev_")
                    .removeprefix("next_")
                    .removeprefix("comm=")
                    .partition(" prev_pid=" if key == "before" else " next_pid=")
                )
                pid, prio, *state = [part.partition("=")[2] or part for part in more.split()]
                who[key] = f"{comm}:{pid} [{prio}]" + (f" {state[0]}" if state else "")
            line = f"{head}: sched_switch:         {who['before']} ==> {who['after']}"
        elif "sched_wakeup" in line:
            line = line.replace("comm=ctl pid=10 prio=50 target_cpu=000", "ctl:10 [50] success=1 CPU:000")
        elif line.startswith("#"):
            continue
        made.append(line.replace("[000] d", "0d").replace("[001] d", "1d"))
    return "\n".join(made) + "\n"


def perf_style(text):
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    made = []
    for line in lines:
        head, tail = line.split(" [", 1)
        name, _, pid = head.strip().rpartition("-")
        core, _, rest = tail.partition("] ")
        made.append(f"{name:>16} {pid:>5} [{core}] {rest.split(maxsplit=1)[1].replace(': sched_', ': sched:sched_')}")
    return "\n".join(made) + "\n"


@pytest.mark.parametrize("style", [str, short_style, perf_style])
def test_ftrace_running_times_are_exact(style):
    trace, report = read_recording(style(KERNEL_STYLE).encode())
    assert running(trace) == RUNNING and trace.hz == 1_000_000
    assert (report.format, report.cores, report.rejected, report.repaired, report.skipped) == ("ftrace", 2, 0, 0, 1)
    assert accounts_for_every_line(report)


def test_a_thread_that_is_preempted_stays_in_its_job():
    trace, _ = read_recording(KERNEL_STYLE.encode())
    row = statistics(trace).loc[("ctl-10", 0)]
    assert (row["jobs"], row["response_max"], row["period"], row["count"]) == (2, 2005.0, 10015.0, 3)
    ready = trace.take(trace.of("switch") & (trace.other == trace.code("ctl-10")))
    assert ready.extra.tolist() == [0, 1, 1]  # preempted, blocked, blocked


def test_times_with_nine_digits_are_nanoseconds():
    text = KERNEL_STYLE.replace("100.000005:", "100.000005250:").replace("100.001005:", "100.001005750:")
    trace, _ = read_recording(text.encode())
    assert trace.hz == 10**9 and running(trace)[("ctl-10", 0)] == 2400.5


def switch(time, core, before, state, after):
    comms = [f"{name} {{0}}_pid={'abc'.find(name) + 1}" for name in (before, after)]
    prev, next_ = (comm.format(side) for comm, side in zip(comms, ("prev", "next")))
    args = f"prev_comm={prev} prev_prio=1 prev_state={state} ==> next_comm={next_} next_prio=1"
    return f"  x-1  [{core:03}] d..2. {time:.6f}: sched_switch: {args}\n"


def test_the_first_to_lose_a_core_had_it_since_the_core_was_seen():
    text = (
        "  x-1  [000] d..2. 5.000000: irq_handler_entry: irq=1\n" + switch(5.25, 0, "a", "S", "b") + switch(6, 0, "b", "S", "0")
    )
    trace, report = read_recording(text.encode())
    assert running(trace) == {"b-2": 750_000.0, "a-1": 250_000.0}
    table = statistics(trace)
    assert (table.loc["a-1", "count"], table.loc["a-1", "cut"], table.loc["b-2", "count"]) == (0, 1, 1)
    assert any("no wakeups" in note for note in report.notes)


@pytest.mark.parametrize("gap", ["CPU:0 [LOST 28 EVENTS]\n", "CPU:0 [EVENTS DROPPED]\n", "CPU:0 [3 EVENTS DROPPED]\n"])
def test_after_lost_events_nobody_is_counted(gap):
    text = switch(1, 0, "0", "R", "a") + gap + switch(3, 0, "a", "S", "b") + switch(4, 0, "b", "S", "0")
    trace, report = read_recording(text.encode())
    assert running(trace) == {"b-2": 1e6} and report.repaired == 1 and accounts_for_every_line(report)
    trace, _ = read_recording(
        (switch(1, 0, "0", "R", "b") + switch(2, 0, "b", "S", "a") + gap + " x-1 [001] d... 9.000000: x: y\n").encode()
    )
    assert running(trace) == {("b-2", 0): 1e6}


def test_a_switch_that_does_not_fit_the_one_before_counts_for_nobody():
    text = switch(1, 0, "0", "R", "a") + switch(3, 0, "b", "S", "c") + switch(4, 0, "c", "S", "0")
    trace, report = read_recording(text.encode())
    assert running(trace) == {"c-3": 1e6} and report.problems[0].line == 2 and "another had it" in str(report)


def test_a_switch_that_cannot_be_read_is_as_good_as_lost():
    text = (
        switch(1, 0, "0", "R", "a") + switch(2, 0, "a", "S", "b").replace("next_pid=2", "next_pid=") + switch(3, 0, "a", "S", "0")
    )
    trace, report = read_recording((text + switch(4, 0, "0", "R", "c") + switch(6, 0, "c", "S", "0")).encode())
    assert running(trace) == {"c-3": 2e6} and (report.rejected, report.repaired) == (1, 1)


def test_lines_out_of_order_are_sorted_and_told():
    lines = KERNEL_STYLE.splitlines(keepends=True)
    lines[7], lines[8] = lines[8], lines[7]
    trace, report = read_recording("".join(lines).encode())
    assert running(trace) == RUNNING and report.moved == (9,)


def test_a_job_that_moves_to_another_core_counts_where_it_ends():
    text = switch(1, 0, "0", "R", "a") + switch(2, 0, "a", "R", "0") + switch(3, 1, "0", "R", "a") + switch(5, 1, "a", "S", "0")
    trace, report = read_recording(text.encode())
    assert running(trace) == {("a-1", 1): 2e6, ("a-1", 0): 1e6}
    assert statistics(trace).loc[("a-1", 1), "response_max"] == 4e6 and "1 jobs moved" in report.notes[0]


def test_a_thread_has_the_last_of_its_names_and_an_exec_makes_no_second_thread():
    text = switch(1, 0, "0", "R", "a") + switch(2, 0, "a", "S", "0").replace("prev_comm=a", "prev_comm=sh")
    assert running(read_recording(text.encode())[0]) == {"sh-1": 1e6}


def test_ftrace_without_switches_says_what_to_record():
    with pytest.raises(LogError, match=r"^text: 3 events of ftrace, none of them sched_switch; record those of sched$"):
        read_recording("  x-1  [000] d..2. 5.000000: irq_handler_entry: irq=1\n" * 3)


# BTF ------------------------------------------------------------------------------------------------------------------------

#: After the example of process events in BTF 2.2, with other times: A runs 100 to 600 and 1000 to 1300, B 600 to 950.
BTF = """\
#version 2.2.0
#creator by hand
# a comment
#timeScale us
0,Timer_A,0,T,A,0,activate
100,Core_1,0,T,A,0,start
150,A,0,R,Step,0,start
500,Timer_B,0,T,B,0,activate
600,Core_1,0,T,A,0,preempt
600,Core_1,0,T,B,0,start
950,Core_1,0,T,B,0,terminate
1000,Core_1,0,T,A,0,resume
1300,Core_1,0,T,A,0,terminate
2000,Timer_A,1,T,A,1,activate
2010,Core_1,0,T,A,1,start
2110,Core_1,0,T,A,1,terminate
"""


@pytest.mark.parametrize(("scale", "us"), [("ns", 1e-3), ("us", 1.0), ("ms", 1e3), ("s", 1e6), ("ps", 1e-6)])
def test_btf_running_and_response_times_are_exact(scale, us):
    trace, report = read_recording(BTF.replace("Scale us", f"Scale {scale}").encode())
    table = statistics(trace)
    assert table["self"].to_dict() == pytest.approx({"A": 900 * us, "B": 350 * us}, rel=1e-12)
    assert table["response_max"].to_dict() == pytest.approx({"A": 1300 * us, "B": 450 * us}, rel=1e-12)
    made = jobs(trace)
    assert made.response.tolist() == [1300, 110, 450] and made.main.tolist() == [800, 100, 350]
    assert (report.format, report.skipped, report.comments, report.repaired, report.rejected) == ("BTF", 1, 4, 0, 0)
    assert accounts_for_every_line(report)


def test_the_published_example_of_the_specification():
    """BTF 2.2, listing 2-7: the times of TASK_InputProcessing are 100000 + 388250 ns, of TASK_1MS 471725 ns."""
    listing = [(6150000, "TIMER_2ms", 3, "InputProcessing", 3, "activate"), (6150100, "Core_1", 0, "InputProcessing", 3, "start")]
    listing += [(6250000, "TIMER_1MS", 6, "1MS", 6, "activate"), (6250100, "Core_1", 0, "InputProcessing", 3, "preempt")]
    listing += [(6250100, "Core_1", 0, "1MS", 6, "start"), (6721825, "Core_1", 0, "1MS", 6, "terminate")]
    listing += [(6721925, "Core_1", 0, "InputProcessing", 3, "resume"), (7110175, "Core_1", 0, "InputProcessing", 3, "terminate")]
    rows = (f"{t},{source},{i},T,TASK_{target},{j},{event}\n" for t, source, i, target, j, event in listing)
    trace, _ = read_recording(("#version 2.2.0\n#timeScale ns\n" + "".join(rows)).encode())
    made = jobs(trace)
    assert dict(zip([trace.names[task] for task in made.task], zip(made.main.tolist(), made.response.tolist()))) == {
        "TASK_InputProcessing": (100_000 + 388_250, 960_175),
        "TASK_1MS": (471_725, 471_825),
    }


def test_btf_of_two_cores_with_waiting_polling_and_an_interrupt():
    text = """#timeScale us
0,Core_2,0,T,B,0,start
10,Core_1,0,T,A,0,start
20,Core_1,0,T,A,0,wait
30,Core_1,0,T,A,0,release
40,Core_1,0,T,A,0,resume
50,Core_1,0,T,A,0,poll
60,Core_1,0,T,A,0,park
70,Core_1,0,T,A,0,poll_parking
75,Core_1,0,T,A,0,run
80,Core_1,0,T,A,0,preempt
80,Core_1,0,I,Tick,0,start
83,Core_1,0,I,Tick,0,terminate
83,Core_1,0,T,A,0,resume
90,Core_1,0,T,A,0,terminate
100,Core_2,0,T,B,0,terminate
"""
    trace, report = read_recording(text)
    assert running(trace) == {("B", 2): 100.0, ("A", 1): 10 + 20 + 10 + 7, ("Tick", 1): 3.0}
    assert "Core_2 is 2" in report.notes[-1] and report.repaired == 0


def test_an_interrupt_nobody_was_preempted_for_gives_the_core_back():
    text = "#timeScale us\n0,C1,0,T,A,0,start\n10,C1,0,I,Tick,0,start\n13,C1,0,I,Tick,0,terminate\n20,C1,0,T,A,0,terminate\n"
    trace, report = read_recording(text)
    assert running(trace) == {"A": 17.0, "Tick": 3.0} and [p.line for p in report.problems] == [3]


def test_a_tracer_of_freertos_that_names_the_task_before_as_source():
    """Only resume and preempt, the source of a resume is the task before, and a new task is said to be preempted."""
    text = """#version 2.2.0
#timeScale us
0,Core_1,0,C,Core_1,0,set_frequency,216000000
0,Core_1,0,T,(0001)IDLE,0,preempt,create pri:0
5,(0000),0,T,(0001)IDLE,0,resume,
105,Core_1,0,T,(0001)IDLE,0,preempt,
105,(0001)IDLE,0,T,(0002)ctl,0,resume,
125,Core_1,0,T,(0002)ctl,0,preempt,
125,(0002)ctl,0,T,(0001)IDLE,0,resume,
225,Core_1,0,T,(0001)IDLE,0,preempt,
"""
    trace, report = read_recording(text)
    assert running(trace) == {"(0001)IDLE": 200.0, "(0002)ctl": 20.0} and report.repaired == report.rejected == 0


def test_numbers_in_place_of_names_are_looked_up():
    text = "#version 2.2.0\n#entityMapping 0 A\n#entityMapping 1 Core_1\n#typeMapping 7 T\n#timescale us\n"
    text += "0,1,0,7,0,0,start\n9,1,0,7,0,0,terminate\n"
    assert running(read_recording(text)[0]) == {"A": 9.0}


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("700,Core_1,0,T,A,0", "is not <time>"),
        ("700,Core_1,0,T,A,0,stop", "'stop' is no event of a task"),
        ("7e2,Core_1,0,T,A,0,preempt", "is not <time>"),
        (f"{10**19},Core_1,0,T,A,0,preempt", "a time beyond any recording"),
        ("700,Core_1,0,T,A\x07,0,preempt", "control characters"),
        ("\x00\x01\x02", "is not <time>"),
        ("y" * 5000, "is not <time>"),
    ],
)
def test_a_line_of_btf_that_cannot_be_read_is_told_and_left_out(line, what):
    trace, report = read_recording(BTF.replace("950,", f"{line}\n950,", 1))
    assert running(trace) == {"A": 900.0, "B": 350.0} and accounts_for_every_line(report)
    assert [(p.line, p.action) for p in report.problems] == [(11, "rejected")] and what in str(report)


def test_a_lost_line_of_btf_never_adds_time():
    whole = {"A": 900.0, "B": 350.0}
    lines = BTF.splitlines(keepends=True)
    for lost in range(4, len(lines)):
        trace, _ = read_recording("".join(lines[:lost] + lines[lost + 1 :]))
        for name, time in running(trace).items():
            assert time <= whole[name], lines[lost]


# Chrome ---------------------------------------------------------------------------------------------------------------------


def kernel_trace():
    k = Kernel(cpu_hz=216_000_000, tick_hz=1000, costs=Costs(tick=300, switch=200, service=100))
    lock = k.mutex("lock")

    def body(os):
        for _ in range(3):
            yield os.take(lock)
            yield os.compute(2 * os.ms)
            yield os.give(lock)
            yield os.delay(3)

    k.task("A", body, 2, deadline=5)
    k.task("B", body, 1)
    return k.run(20 * k.ms).trace


TASKS = {
    "tasks": [{"name": n, "period": p, "wcet": 3, "ecet": 2, "ep_wcet": 1, "times": [2, 3]} for n, p in (("a", 5), ("b", 7))]
}


def samples():
    yield kernel_trace()
    yield schedule(TASKS, "taft", 60)[1]
    yield schedule(TASKS, "edf", 60)[1]
    yield kernel_trace().window(2_000_000, 3_000_000)
    yield read_log("a 0 1\nb 1 1\nb 2 0\nc 2 1\nc 2 0\na 2 0\nd 5 1\n")[0]
    yield read_log("f 0 1 0\ng 2 1 1\ng 6 0 1\nf 10 0 0\ng 11 0 0\n")[0]
    yield read_recording(KERNEL_STYLE.encode())[0]
    yield read_recording(BTF.encode())[0]


EXPORTS = {"JSON": export_chrome, "CSV": export_csv, "npz": export_npz}


@pytest.mark.parametrize("format", EXPORTS)
@pytest.mark.parametrize("sample", range(8))
def test_what_is_exported_is_read_with_the_same_statistics(format, sample, tmp_path):
    trace = list(samples())[sample]
    path = tmp_path / "without an ending"
    EXPORTS[format](trace, path)
    back, report = read_recording(path)
    assert (back.names, back.hz, back.start, back.end) == (trace.names, trace.hz, trace.start, trace.end)
    assert report.format == f"lab {format}" and report.problems == ()
    ours, theirs = statistics(back), statistics(trace)
    assert ours.equals(theirs.loc[ours.index]) and len(ours) == len(theirs)
    assert jobs(back).frame().equals(jobs(trace).frame()) if trace.core is None else True
    ours, theirs = (spans(some).sort_values(["start", "end", "depth", "name"]).reset_index(drop=True) for some in (back, trace))
    assert ours.equals(theirs)


def events(*rows):
    return json.dumps({"traceEvents": [dict(zip(("ph", "pid", "tid", "name", "ts", "dur"), row)) for row in rows]})


def test_chrome_json_of_others():
    """Two threads: f 0 to 10 with g 2 to 5 inside, and h 3.5 to 4 on the other."""
    text = events(
        *[("M", 1, 1, "thread_name", 0), ("X", 1, 1, "f", 0, 10), ("X", 1, 1, "g", 2, 3), ("i", 1, 1, "x", 3)],
        *[("B", 1, 2, "h", 3.5), ("E", 1, 2, "", 4), ("E", 1, 2, "", 9), ("B", 1, 2, "k", 9)],
    )
    trace, report = read_recording(text.encode())
    assert running(trace) == {("f", 0): 7.0, ("g", 0): 3.0, ("h", 1): 0.5} and trace.hz == 10**9
    assert (report.format, report.rejected, report.repaired, report.skipped) == ("Chrome JSON", 1, 1, 2)
    assert accounts_for_every_line(report)


def test_a_function_that_calls_itself_is_told_apart_by_depth():
    trace, _ = read_recording(events(("X", 1, 1, "f", 0, 10), ("X", 1, 1, "f", 2, 6), ("X", 1, 1, "f", 3, 1)).encode())
    assert running(trace) == {"f": 4.0, "f#2": 5.0, "f#3": 1.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"traceEvents": 3}', "trace events are a list"),
        ('{"a": 1}', "trace events are a list"),
        ("[{}]", "none of them a span"),
        ('{"traceEvents": [', "not JSON"),
        ('{"a":' * 100_000, "nested too deeply"),
        ('{"otherData": {"labkit": {}}, "traceEvents": []}', "not as export_chrome wrote it"),
    ],
)
def test_what_is_no_json_of_events_is_told_in_one_sentence(text, message):
    with pytest.raises(LogError, match=r"^[^\n]+$") as error:
        read_recording(text.encode())
    assert message in str(error.value)


def test_json_beyond_the_limit_is_told(monkeypatch):
    monkeypatch.setattr(chrome_, "MOST_BYTES", 1 << 20)
    with pytest.raises(LogError, match="longer than 1 MiB"):
        read_recording(b"[{}" + b" " * (2 << 20))


# Recognition ----------------------------------------------------------------------------------------------------------------


def test_a_log_is_a_log_whatever_its_names_look_like():
    for text in ("a,b,c,T,d,e,f 1 1\na,b,c,T,d,e,f 2 0\n", "# {\na 1 1\na 2 0\n", "[x] 1 1\n[x] 2 0\n", "{ 1 1\n{ 2 0\n"):
        trace, report = read_recording(text.encode())
        assert report.format == "log" and len(trace) == 2, text


def test_path_file_bytes_and_text_are_the_same(tmp_path):
    path = tmp_path / "x"
    path.write_text(BTF)
    with path.open("rb") as binary, path.open() as text:
        for source in (path, str(path), binary, text, BTF, BTF.encode(), BTF.encode("utf-16"), io.StringIO(BTF)):
            assert running(read_recording(source)[0]) == {"A": 900.0, "B": 350.0}


def test_a_clock_belongs_to_a_log():
    assert read_recording("a 1 1\na 2 0\n", clock_hz=216e6)[1].format == "log"
    with pytest.raises(LogError, match="this is BTF, whose times do not wrap"):
        read_recording(BTF, clock_hz=216e6)


@given(st.data())
def test_any_damage_is_told_or_refused(data):
    """Whatever is cut out, doubled or written over: an error, or a report that accounts for every line."""
    sample = data.draw(st.sampled_from([KERNEL_STYLE, short_style(KERNEL_STYLE), perf_style(KERNEL_STYLE), BTF]))
    at, length = data.draw(st.integers(0, len(sample))), data.draw(st.integers(0, 200))
    text = sample[:at] + data.draw(st.one_of(st.text(max_size=20), st.just(sample[at : at + length] * 2))) + sample[at + length :]
    try:
        trace, report = read_recording(text.encode())
    except LogError as error:
        assert "\n" not in str(error)
        return
    assert accounts_for_every_line(report) and (np.diff(trace.time) >= 0).all()
    assert statistics(trace)["share"].fillna(0).groupby(level=-1 if trace.core is not None else 0).sum().max() <= 1.0000001


# The samples ----------------------------------------------------------------------------------------------------------------


def make_examples():
    spec = importlib.util.spec_from_file_location("make_examples", Path(__file__).with_name("make_examples.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_samples_are_as_made_and_all_tell_what_was_simulated():
    maker = make_examples()
    truth = statistics(maker.simulated())["self"].to_dict()
    for name, text in maker.made().items():
        assert (maker.EXAMPLES / name).read_text(encoding="utf-8") == text, f"{name}: run tests/trace/make_examples.py"
    for name in (*maker.made(), "run.csv", "run.json"):
        found = running(read_recording(maker.EXAMPLES / name)[0])
        assert {task.split("-")[0]: time for task, time in found.items()} == truth, name
