"""The command line: what each command prints, and one sentence with exit code 1 for bad input."""

import json
from pathlib import Path

import pytest

from labkit.__main__ import main
from labkit.cache import count_trace

CACHEGRIND = Path(__file__).parent / "oracle" / "cachegrind"


@pytest.mark.parametrize(("size", "ways", "line"), [(16384, 4, 32), (4096, 1, 32), (8192, 2, 64)])
def test_cache_prints_what_cachegrind_counted(size, ways, line, capsys):
    counted = json.loads((CACHEGRIND / "mm.json").read_text(encoding="utf-8"))["counts"]
    wanted = next(c for key, c in counted.items() if key.startswith(f"dcache {size} {ways} {line},"))
    options = ["--size", str(size), "--ways", str(ways), "--line", str(line)]
    assert main(["cache", str(CACHEGRIND / "mm_data.npz"), *options, "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)["counts"]
    found = [counts[name] for name in ("reads", "read_misses", "writes", "write_misses")]
    assert found == [wanted[name] for name in ("Dr", "D1mr", "Dw", "D1mw")]

    assert main(["cache", str(CACHEGRIND / "mm_data.npz"), *options]) == 0
    printed = capsys.readouterr().out
    assert f"{size} bytes, {ways} ways, lines of {line} bytes, policy lru" in printed
    assert f"reads: {wanted['Dr']}, of them missed {wanted['D1mr']} ({100 * wanted['D1mr'] / wanted['Dr']:.2f} %)" in printed


@pytest.mark.parametrize("policy", ["plru", "fifo", "random"])
def test_cache_takes_every_policy(policy, capsys):
    trace = CACHEGRIND / "unaligned_data.npz"
    assert main(["cache", str(trace), "--policy", policy, "--seed", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["counts"] == count_trace(trace, policy=policy, seed=3)


@pytest.mark.parametrize(("options", "sentence"), [
    (["--size", "3000"], "size is 3000 bytes; it must be a power of two"),
    (["--ways", "0"], "ways is 0; a cache has at least 1 way"),
    (["--policy", "mru"], "no replacement policy 'mru'; there are"),
])
def test_cache_refuses_in_one_sentence(options, sentence, capsys):
    assert main(["cache", str(CACHEGRIND / "mm_data.npz"), *options]) == 1
    error = capsys.readouterr().err
    assert error.startswith("labkit cache: ") and sentence in error and error.count("\n") == 1


def test_cache_names_the_file_that_is_not_there_or_no_trace(tmp_path, capsys):
    assert main(["cache", str(tmp_path / "gone.npz")]) == 1
    assert "there is no file" in capsys.readouterr().err
    (tmp_path / "text.npz").write_text("op,addr,size", encoding="utf-8")
    assert main(["cache", str(tmp_path / "text.npz")]) == 1
    assert "cannot be read as an .npz file" in capsys.readouterr().err
