"""`labkit track`: what it writes, what it tells, and every mistake in one sentence."""

import csv
import json

import numpy as np
import pytest

from labkit.__main__ import main
from labkit.data import example
from labkit.fusion import ESTIMATE

HEAD = "t_s,x_m,y_m,station\n"


def run(tmp_path, *more: str, text: str | None = None) -> list[dict[str, str]]:
    source = example("positions.csv")
    if text is not None:
        source = tmp_path / "m.csv"
        source.write_text(text, encoding="utf-8")
    out = tmp_path / "e.csv"
    assert main(["track", str(source), "--q", "0.1", "--sigma", "0.03", "--out", str(out), *more]) == 0
    with open(out, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_estimates_of_the_sample_file(tmp_path, capsys):
    rows = run(tmp_path, "--json")
    told = json.loads(capsys.readouterr().out)
    assert tuple(rows[0]) == ESTIMATE and {row["track"] for row in rows} == {"1", "2", "3"}
    assert told["used"] == len(rows) == 108 and told["measurements"] == 112 and told["unused"] == 4
    assert told["ignored_columns"] == ["arrived_s"] and told["moved"] > 0
    assert sum(track["measurements"] for track in told["tracks"]) == len(rows)
    assert all(1 < track["mean_nis"] < 3 for track in told["tracks"])
    times = [float(row["t_s"]) for row in rows]
    assert times == sorted(times)
    last = {row["track"]: row for row in rows}
    speeds = [np.hypot(float(row["vx_mps"]), float(row["vy_mps"])) for row in last.values()]
    assert speeds == pytest.approx([0.5] * 3, abs=0.2)


def test_the_report_is_for_reading_too(tmp_path, capsys):
    run(tmp_path)
    printed = capsys.readouterr().out
    assert "112 measurements, 108 used, 3 tracks" in printed and "'arrived_s'" in printed and "track 3:" in printed
    assert printed.count("if sigma and q fit") == 3


@pytest.mark.parametrize("model", ["cp", "cv", "ca"])
def test_the_first_row_is_the_first_measurement_with_the_variances_that_are_stated(model, tmp_path):
    first, second = run(tmp_path, "--model", model, text=HEAD + "2,1,1,A\n1,0.97,1,A\n")
    assert [float(first[name]) for name in ESTIMATE] == [1, 1, 0.97, 1, 0, 0, 0.03**2, 0.03**2]
    moved = 0.0 if model == "cp" else 0.02
    assert (float(second["vx_mps"]) > moved) == (model != "cp")
    assert 0.97 < float(second["x_m"]) < 1


@pytest.mark.parametrize("association", ["global", "source", "joint"])
def test_no_measurement_is_a_file_with_a_head(association, tmp_path):
    assert run(tmp_path, "--association", association, text=HEAD) == []
    assert (tmp_path / "e.csv").read_text() == ",".join(ESTIMATE) + "\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--sigma", "0"], "sigma is 0.0 m; 1e-06 to 1e+06 is allowed"),
        (["--sigma", "nan"], "sigma is nan m"),
        (["--q", "-1"], "q is -1.0; 0 to 1e12 is allowed"),
        (["--gate", "1"], "the gate is 1.0; a share between 0 and 1 is allowed"),
        (["--confirm", "0"], "confirm is 0; a whole number of at least 1 is allowed"),
        (["--association", "source", "--a-max", "nan"], "a_max is nan"),
        (["--association", "source", "--e-max", "-1"], "e_max is -1.0"),
        (["--out", "."], "."),
    ],
)
def test_a_mistake_is_one_sentence(arguments, sentence, tmp_path, capsys):
    path = tmp_path / "m.csv"
    path.write_text(HEAD + "0,0,0,A\n", encoding="utf-8")
    command = ["track", str(path), "--q", "1", "--sigma", "1", "--out", str(tmp_path / "e.csv"), *arguments]
    assert main(command) == 1
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1 and error.startswith("labkit track: ")
    assert not (tmp_path / "e.csv").exists()
