"""The published tables: every file is described in data/README.md, every value has the stated type, every erratum recomputes."""

import csv
import re
from pathlib import Path

import pytest

DATA = Path(__file__).parents[1] / "data"
FILES = sorted(path.name for path in DATA.iterdir() if path.is_file() and path.name != "README.md")
PARSE = {"text": str, "integer": int, "number": float}


def described() -> dict[str, list[tuple[str, str, str]]]:
    """File name -> (column, type, unit) of each column, as the README has them."""
    sections = re.split(r"^## (\S+)\n", (DATA / "README.md").read_text(encoding="utf-8"), flags=re.M)
    rows = r"^\| (?!column )([^|]+?) \| (\w+) \| ([^|]+?) \| [^|]+ \|$"
    return {name: re.findall(rows, text, flags=re.M) for name, text in zip(sections[1::2], sections[2::2], strict=True)}


def table(name: str) -> tuple[list[str], list[list[str]]]:
    lines = (DATA / name).read_text(encoding="utf-8").splitlines()
    if name.endswith(".log"):  # as the board sends it: no header, separated by blanks
        return ["name", "time_us", "begin"], [line.rsplit(" ", 2) for line in lines]
    header, *rows = csv.reader(lines, strict=True)
    return header, rows


def records(name: str) -> list[dict[str, str]]:
    header, rows = table(name)
    return [dict(zip(header, row, strict=True)) for row in rows]


def recording(row: dict[str, str]) -> tuple[str, ...]:
    return row["platform"], row["wheel_hz"], row["pose_hz"], row["caches"]


def test_every_file_is_described_and_every_description_has_a_file():
    assert sorted(described()) == FILES


@pytest.mark.parametrize("name", FILES)
def test_columns_and_types_are_as_described(name):
    columns = described()[name]
    header, rows = table(name)
    assert [column for column, _, _ in columns] == header
    assert rows, f"{name} is empty"
    for number, row in enumerate(rows, start=1):
        assert len(row) == len(header), f"{name}, row {number}"
        for (column, kind, _), value in zip(columns, row, strict=True):
            if value:
                try:
                    PARSE[kind](value)
                except ValueError:
                    pytest.fail(f"{name}, row {number}, {column}: {value!r} is no {kind}")


def test_shares_fit_the_rows_and_only_the_total_of_table_9_does_not():
    totals = {recording(row): int(row["stated_sum_us"]) for row in records("xu2025_stated_totals.csv")}
    summed = dict.fromkeys(totals, 0)
    for row in records("xu2025_runtime_stats.csv"):
        summed[recording(row)] += int(row["sum_us"])
    for row in records("xu2025_runtime_stats.csv"):
        assert float(row["share_pct"]) == pytest.approx(100 * int(row["sum_us"]) / summed[recording(row)], abs=0.0051)
    off = {key: totals[key] - summed[key] for key in totals if totals[key] != summed[key]}
    assert off == {("FreeRTOS", "100", "50", "on"): 181_812}
    assert summed["FreeRTOS", "100", "50", "on"] == 18_261_779
    assert summed["FreeRTOS", "100", "50", "on"] - summed["FreeRTOS", "100", "50", "off"] == 31_772
    assert totals["FreeRTOS", "100", "50", "on"] - totals["FreeRTOS", "100", "50", "off"] == 213_584


def test_activations_and_idle_are_what_the_errata_say():
    stats = {(*recording(row), row["name"]): row for row in records("xu2025_runtime_stats.csv")}

    def count(*key: str) -> float:
        return int(stats[key]["sum_us"]) / float(stats[key]["mean_us"])

    assert round(count("micro-ROS", "100", "50", "on", "odom")) == 1813
    assert round(count("FreeRTOS", "100", "50", "on", "odometry")) == 915
    idle_off, idle_on = (int(stats["FreeRTOS", "100", "50", caches, "IDLE"]["sum_us"]) for caches in ("off", "on"))
    assert round(100 * (idle_on / idle_off - 1), 2) == 17.48

    def rates(platform: str, *names: str) -> list[float]:
        length = {
            c: sum(int(row["sum_us"]) for key, row in stats.items() if key[:4] == (platform, "50", "30", c))
            for c in ("off", "on")
        }
        return sorted(round(count(platform, "50", "30", c, name) / length[c] * 1e6, 1) for c in length for name in names)

    assert rates("micro-ROS", "p_ctrl") == [33.0, 33.2]
    assert rates("FreeRTOS", "odometry", "pose_control") == [30.4, 30.4, 30.9, 31.2]


def test_how_much_longer_the_recording_with_caches_is():
    """By activations times period, of the clocks that are interrupted in neither recording; the README and notebook 02 say so."""
    rows = {recording(row)[3]: {} for row in records("xu2025_runtime_stats.csv")}
    for row in records("xu2025_runtime_stats.csv"):
        if recording(row)[:3] == ("micro-ROS", "100", "50"):
            rows[row["caches"]][row["name"]] = int(row["sum_us"]) / float(row["mean_us"])
    for name, period, off, on in (("w_ctrl", 10, 1830, 1844), ("p_ctrl", 20, 915, 922)):
        assert rows["off"][name] == pytest.approx(off, abs=0.1) and rows["on"][name] == pytest.approx(on, abs=0.1)
        assert (on - off) * period == 140
    assert rows["off"]["profile"] > 5 * 1830  # every 10 ms, too, and cut into stretches: no clock
    words = " ".join((DATA / "README.md").read_text(encoding="utf-8").split())
    assert "the longer one, by 140 ms, give or take a period" in words
    assert "14 wheel callbacks of 10 ms more (1 844 to 1 830) and 7 pose callbacks of 20 ms more (922 to 915)" in words
    notebook = (DATA.parent / "notebooks" / "02_cache_speedups.ipynb").read_text(encoding="utf-8")
    assert "the *longer* one, by 140 ms" in notebook and "with caches is 140 ms longer" in notebook


def test_windows_end_where_they_say_but_for_the_swapped_digits():
    rows = records("diplom_table5_windows.csv")
    ends = [int(row["deadline_from_period_start_ns"]) for row in rows]
    added = [sum(int(row["deadline_ns"]) for row in rows[: i + 1]) for i in range(len(rows))]
    assert [a - e for a, e in zip(added, ends, strict=True)] == [0] * 7 + [63, 63]
    fair_split = 98_000_000 * 35.1 / (6 * 4.1 + 34.4 + 35.1)
    assert round(fair_split) == 36_554_729


def test_half_a_period_of_drift_takes_33_hours():
    value = {(row["experiment"], row["quantity"]): row["value"] for row in records("diplom_measurements.csv")}
    period = float(value["2 coherence", "period"])
    length = period * float(value["2 coherence", "periods recorded (approx.)"])
    drift = float(value["2 coherence", "max timestamp difference without coordination"]) / length
    assert round(drift * 1e6, 1) == 2.1
    assert 32 < period / 2 / drift / 3_600_000 < 33.5
