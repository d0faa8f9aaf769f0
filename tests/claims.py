"""What the two sources print and what comes out here: the table in data/README.md, which `python tests/claims.py` rewrites.

Verdicts are computed: *reproduced* is within the tolerance of the claim, *refuted* is not, *not derivable* needs hardware or data
that are not published.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from labkit.data import published_table
from labkit.experiments import Listings, PhaseWindows, QueueOrMiddleware, SixDesigns, TickBound, TimestampDrift, cells, printed
from labkit.sink import check_sink

README = Path(__file__).parents[1] / "data" / "README.md"
HEADING = "## What became of the published numbers\n"
TABLES = [(p, r, c) for p in ("micro-ROS", "FreeRTOS") for r in ("50|30", "100|50") for c in (False, True)]  # tables 2 to 9


#: (platform, task or callback) -> printed rise of its sum at 100|50 Hz when the caches go on, in %; and what stands behind it.
RISES = {
    **{("micro-ROS", name): told for name, told in (("odom", -62.64), ("p_ctrl", -76.51), ("w_ctrl", -66.06), ("IDLE", 98.35))},
    ("FreeRTOS", "odometry"): -72.04,
    ("FreeRTOS", "pose_control"): -70.43,
    ("FreeRTOS", "wheel_ctrl"): -72.17,
    ("FreeRTOS", "IDLE"): 14.88,
}
WHY = {key: f"sums of the tables{'' if key[0] == 'FreeRTOS' else ', of unequal numbers of activations'}" for key in RISES}
WHY["FreeRTOS", "IDLE"] = "14.88 is the rise divided by the new sum"


@dataclass(frozen=True)
class Claim:
    """A printed number (`told`, in `unit`) and how it is found again; `found` None: it cannot be. A sentence is told as text."""

    place: str
    what: str
    told: float | str
    unit: str
    found: Callable[[], float | str] | None
    tolerance: float
    how: str

    def row(self) -> tuple[str, str]:
        """Verdict and line of the table."""
        if self.found is None:
            return "not derivable", self._line("–", "not derivable")
        ours = self.found()
        if isinstance(self.told, str) or isinstance(ours, str):
            same = ours == self.told
        else:
            same = abs(ours - self.told) <= self.tolerance
        verdict = "reproduced" if same else "refuted"
        return verdict, self._line(_text(ours, self.unit), verdict)

    def _line(self, ours: str, verdict: str) -> str:
        return f"| {self.place} | {self.what} | {_text(self.told, self.unit)} | {ours} | {verdict} | {self.how} |"


def _text(value: float | str, unit: str) -> str:
    return value if isinstance(value, str) else f"{value:.10g} {unit}".strip()


def _source_1() -> Iterator[Claim]:
    stats, totals = published_table("xu2025_runtime_stats.csv"), published_table("xu2025_stated_totals.csv")
    for total in totals.itertuples():
        rows = stats[stats["thesis_table"] == total.thesis_table]
        where = f"1, table {total.thesis_table}"
        yield Claim(
            where, "total of the sums", total.stated_sum_us, "us", lambda r=rows: int(r["sum_us"].sum()), 5, "sum of its rows"
        )
        off = abs(rows["sum_us"] / rows["sum_us"].sum() * 100 - rows["share_pct"]).max()
        yield Claim(
            where, f"shares of its {len(rows)} rows", 0, "points off", lambda o=off: round(o, 3), 0.011, "sum / sum of all rows"
        )
    for i, (platform, rates, caches) in enumerate(TABLES, start=2):
        if platform == "micro-ROS":
            table = printed(platform, rates, caches)
            idle = round(table.share("IDLE", "doubled"), 2)
            where = f"1, table {i}"
            found = lambda t=table: round(t.share("IDLE"), 2)  # noqa: E731
            yield Claim(
                where, "IDLE as a share of the recording", idle, "%", found, 0.05, "callbacks run inside uros: counted once"
            )
    for i, key in enumerate(TABLES, start=2):
        worst = lambda k=key: round(float((_cells(*k)["model share"] - _cells(*k)["share"]).abs().max()), 2)  # noqa: E731
        yield Claim(f"1, table {i}", "shares of the recording, from a run of the model", 0, "points off", worst, 2, "notebook 06")
    yield Claim(
        "1, tables 2 to 9",
        f"{len(stats)} mean times of an activation",
        "as printed",
        "",
        None,
        0,
        "measured; the model takes them as given",
    )
    for (platform, name), told in RISES.items():
        found = lambda p=platform, n=name: _rise(p, n)  # noqa: E731
        yield Claim("1, 5.3", f"{platform} 100\\|50, caches on: sum of {name}", told, "%", found, 0.006, WHY[platform, name])
    yield Claim(
        "1, 5.3.2",
        "difference in length, FreeRTOS 100\\|50",
        213.584,
        "ms",
        lambda: _difference("FreeRTOS", "100|50"),
        0.001,
        "follows from the wrong total of table 9",
    )
    yield Claim(
        "1, 5.3.2",
        "difference in length, micro-ROS 100\\|50",
        349.045,
        "ms",
        lambda: _difference("micro-ROS", "100|50"),
        0.001,
        "it is that of tables 2 and 3, of sums that count callbacks twice",
    )
    yield Claim(
        "1, 5",
        "pose control at 30 Hz under micro-ROS: its rate",
        30,
        "Hz",
        lambda: round(printed("micro-ROS", "50|30", False).rows["p_ctrl"].rate, 1),
        0.5,
        "periods were whole milliseconds",
    )
    yield Claim(
        "1, 5",
        "odometry at 50\\|30 under micro-ROS: its rate",
        30,
        "Hz",
        lambda: round(printed("micro-ROS", "50|30", False).rows["odom"].rate, 1),
        0.5,
        "it ran with the wheel control",
    )
    for name, told in (("odometry", -3.10), ("pose control", 65.28), ("wheel control", 92.90)):
        yield Claim(
            "1, table 10",
            f"{name}, micro-ROS minus FreeRTOS, mean",
            told,
            "us",
            lambda n=name: round(_middleware()[f"{n}: mean, difference"], 1),
            5,
            "model, notebook 06",
        )
    micro, free = (printed(p, "100|50", True).rows[n].total for p, n in (("micro-ROS", "odom"), ("FreeRTOS", "odometry")))
    yield Claim(
        "1, table 10",
        "odometry, micro-ROS minus FreeRTOS, sum",
        -524,
        "us",
        lambda: micro - free,
        1,
        "sign; and of 1 813 against 915 activations",
    )
    for listing, told in (("37", (200, 500)), ("38", (100, 200))):
        gaps = _listing(listing)
        for task, value in zip(("wheel_ctrl", "slow task"), told, strict=True):
            name = f"{task}, gap between starts"
            yield Claim(
                f"1, listing {listing}",
                f"{task} starts every",
                value,
                "us",
                lambda g=gaps, n=name: g[n].published,
                8,
                "the listing's own stamps",
            )
            yield Claim(
                f"1, listing {listing}",
                f"{task}: that gap, from the model",
                gaps[name].published,
                "us",
                lambda g=gaps, n=name: round(g[n].value, 1),
                12,
                "notebook 05",
            )
    yield Claim(
        "1, 5.4",
        "micro-ROS at 1000 Hz: what it reaches",
        "910 to 980 Hz",
        "",
        None,
        0,
        "depends on the agent's host; 919 to 977 Hz with stated values, notebook 06",
    )
    yield Claim(
        "1, 5.4",
        "an upper bound of the tick rate",
        "none",
        "",
        lambda: f"{TickBound().measure('bound, ticks alone'):.0f} Hz",
        0,
        "cost of a tick x rate < 1, for a tick of 200 cycles",
    )
    yield Claim(
        "1, 4.1",
        "the sink sends what was written",
        "ok",
        "",
        lambda: check_sink("published-first").verdict,
        0,
        "every interleaving, notebook 04",
    )
    yield Claim("1, 4.1", "a global order of the producers halves the throughput", "half", "", None, 0, "needs the board")
    yield Claim("1, 4.4, 4.5", "the checksum unit takes 1.6 % of the cycles of software", 1.6, "%", None, 0, "needs the board")
    yield Claim("1, MPU regions", "MPU region 1 lies at", "0x30004000", "", _memory, 0, "no memory of the F767 lies there")


def _source_2() -> Iterator[Claim]:
    windows = published_table("diplom_table5_windows.csv")
    made = _windows()
    for row in windows.itertuples():
        if row.phase in made:
            yield Claim(
                "2, table 5",
                f"window of {row.phase}",
                row.deadline_ns,
                "ns",
                lambda r=row: made[r.phase],
                0,
                "fair split (4.12), notebook 08",
            )
    yield Claim(
        "2, 4.2",
        "which of six designs keeps all four promises below the sum of WCETs",
        "taft windows",
        "",
        _designs,
        0,
        "60 periods of random run times, notebook 08",
    )
    yield Claim(
        "2, chapter 7, 1", "deadlines missed in 400 periods", 0, "", lambda: _experiment_1("deadlines missed"), 0, "notebook 08"
    )
    for station, told in ((1, 121), (2, 123)):
        yield Claim(
            "2, chapter 7, 1",
            f"contour filter aborted, station {station}",
            told,
            "periods",
            None,
            0,
            "the run times are not published; 42 to 116 by the assumed law",
        )
    yield Claim(
        "2, chapter 7, 2",
        "difference of time stamps without coordination",
        2350,
        "us",
        lambda: round(_drift("none")),
        24,
        "at 2.14 ppm, which this number implies",
    )
    yield Claim(
        "2, chapter 7, 2",
        "the same with coordination",
        128.17,
        "us",
        None,
        0,
        "depends on the reading error: about 64 us gives it, notebook 09",
    )
    yield Claim(
        "2, figure 21",
        "largest offset of two free stations, period 500 ms",
        "250 to 500 ms",
        "",
        lambda: "at most 250 ms, after 32 hours",
        0,
        "half a period is the most there is, notebook 09",
    )
    yield Claim(
        "2, chapter 7, 3",
        "time stamps differ at fusion by",
        "160 to 170 ms",
        "",
        None,
        0,
        "the offset is a setting (160 ms), its spread was measured",
    )
    yield Claim("2, 4.2", "longest run of the contour filter", 140, "ms", None, 0, "measured; an input of the model")
    yield Claim("2, 4.2", "90 % of its runs stay below", 50, "ms", None, 0, "measured; an input of the model")
    yield Claim(
        "2, 6.2",
        "scans per second at 38 400 baud",
        3,
        "1/s",
        None,
        0,
        "5.2 at 0.5 degrees, 2.6 at 0.25: the resolution is not named",
    )


@cache
def _cells(*key):
    return cells(*key)


@cache
def _middleware() -> dict[str, float]:
    return QueueOrMiddleware(rates="100|50").values()


@cache
def _listing(listing: str):
    experiment = Listings(listing=listing)
    return {m.name: m for m in experiment.metrics(experiment.run())}


def _rise(platform: str, name: str) -> float:
    """By how many percent the sum changes at 100|50 Hz when the caches go on."""
    off, on = (printed(platform, "100|50", caches).rows[name].total for caches in (False, True))
    return round(100 * (on / off - 1), 2)


def _difference(platform: str, rates: str) -> float:
    off, on = (printed(platform, rates, caches).doubled() for caches in (False, True))
    return round(abs(on - off) / 1e3, 3)


def _memory() -> str:
    regions = published_table("xu2025_memory_map.csv")
    start, end = (np.array([int(text, 16) for text in regions[column]]) for column in ("start", "end"))
    address = 0x30004000
    return hex(address) if ((start <= address) & (address <= end)).any() else "outside every memory"


def _windows() -> dict[str, int]:
    experiment = PhaseWindows()
    result = experiment.run()
    assert not isinstance(result, str)
    return {window.phase: window.deadline_ns for window in result}


def _designs() -> str:
    runs = SixDesigns().run().runs
    kept = [name for name, run in runs.items() if not isinstance(run, str) and all(g.kept for g in run.guarantees)]
    return ", ".join(kept)


@cache
def _experiment_1(metric: str) -> int:
    from labkit.experiments import Timeliness

    return Timeliness().measure(metric)


def _drift(correction: str) -> float:
    return TimestampDrift(period=500, periods=2200, drift=2.14, correction=correction).measure("largest difference")


def section() -> str:
    """The part of data/README.md that is made here."""
    rows = [claim.row() for claim in (*_source_1(), *_source_2())]
    verdicts = [verdict for verdict, _ in rows]
    counts = ", ".join(f"{verdicts.count(word)} {word}" for word in ("reproduced", "refuted", "not derivable"))
    head = "| source, place | what | printed | here | verdict | how |\n|---|---|---|---|---|---|\n"
    made = "Made by `tests/claims.py`, which computes every verdict; a test compares it with this text."
    return f"{HEADING}\n{made} {len(rows)} claims: {counts}.\n\n{head}" + "\n".join(line for _, line in rows) + "\n"


if __name__ == "__main__":
    README.write_text(README.read_text(encoding="utf-8").split(HEADING)[0].rstrip() + "\n\n" + section(), encoding="utf-8")
