"""Panels become one picture: axes, domains, references, titles and legend, and none of them by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.figures.panel import Panel, stack
from labkit.figures.style import KEYS, axis, key

LINE = {"type": "scatter", "x": [0, 1], "y": [0, 1]}


def panel(**more):
    return Panel([LINE], axis("y"), **{"x": axis("x"), **more})


panels = st.builds(
    panel,
    title=st.sampled_from(["", "above"]),
    height=st.floats(0.2, 3),
    width=st.floats(0.2, 3),
    left=st.integers(40, 150),
    above=st.sampled_from([0, 60]),
)


@given(st.lists(st.lists(panels, min_size=1, max_size=3), min_size=1, max_size=3))
def test_panels_never_overlap_and_stay_in_the_picture(rows):
    layout = stack(*rows, height=1000)["layout"]
    areas = []
    for n in range(1, sum(map(len, rows)) + 1):
        x, y = (layout[f"{letter}axis{n if n > 1 else ''}"] for letter in "xy")
        assert (x["anchor"], y["anchor"]) == (f"y{n if n > 1 else ''}", f"x{n if n > 1 else ''}")
        areas.append((*x["domain"], *y["domain"]))
    assert all(0 <= left < right <= 1 and -1e-9 <= low < high <= 1 for left, right, low, high in areas)
    for i, (left, right, low, high) in enumerate(areas):
        for left2, right2, low2, high2 in areas[:i]:
            assert right <= left2 or right2 <= left or high <= low2 or high2 <= low


@given(st.lists(panels, min_size=2, max_size=3))
def test_there_is_room_for_what_stands_above_a_panel(rows):
    height = 900
    layout = stack(*rows, height=height)["layout"]
    room = height - layout["margin"]["t"] - layout["margin"]["b"]
    for n, lower in enumerate(rows[1:], start=2):
        upper = layout["yaxis" if n == 2 else f"yaxis{n - 1}"]["domain"][0]
        gap = room * (upper - layout[f"yaxis{n}"]["domain"][1])
        assert gap >= (lower.above or 30 * bool(lower.title)) + 40  # and the ticks and title of the axis above


def test_a_shared_axis_stands_below_the_lowest_panel():
    spec = stack(panel(x=None), panel(x=None), height=500, shared=axis("time [ms]", range=[0, 9]))
    assert [trace["xaxis"] for trace in spec["data"]] == ["x", "x"] and [t["yaxis"] for t in spec["data"]] == ["y", "y2"]
    assert spec["layout"]["xaxis"]["anchor"] == "y2" and "xaxis2" not in spec["layout"]
    assert spec["layout"]["yaxis"]["domain"][0] > spec["layout"]["yaxis2"]["domain"][1]


@pytest.mark.parametrize("shared", [None, axis("time [ms]")])
def test_an_axis_too_many_or_too_few_is_refused(shared):
    with pytest.raises(ValueError, match="every panel has an x axis of its own, or all share one"):
        stack(panel(), panel(x=None), height=500, shared=shared)


def test_shapes_and_notes_refer_to_their_own_panel():
    marked = panel(shapes=[{"type": "line"}, {"type": "line", "yref": "y domain"}], notes=[{"text": "here", "xref": "paper"}])
    layout = stack([panel(), marked], height=500)["layout"]
    assert [(s["xref"], s["yref"]) for s in layout["shapes"]] == [("x2", "y2"), ("x2", "y2 domain")]
    assert [(n["xref"], n["yref"]) for n in layout["annotations"]] == [("paper", "y2")]


def test_titles_stand_at_the_left_upper_corner_of_their_panel():
    layout = stack([panel(title="one"), panel(title="two", remark="late")], height=500)["layout"]
    for note, x in zip(layout["annotations"], ("xaxis", "xaxis2"), strict=True):
        assert (note["x"], note["y"]) == (layout[x]["domain"][0], 1.0)
    assert "<b>two</b>" in layout["annotations"][1]["text"] and "late" in layout["annotations"][1]["text"]


def test_legend_entries_come_by_name_and_draw_nothing():
    spec = stack(panel(), height=500, keys=[*KEYS, key("own", type="bar", marker={"color": "red"})])
    entries = spec["data"][1:]
    assert [trace["name"] for trace in entries] == [*KEYS, "own"]
    assert all(trace["x"] == [None] == trace["y"] for trace in entries)
    with pytest.raises(KeyError):
        stack(panel(), height=500, keys=["no such entry"])
