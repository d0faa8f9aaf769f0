"""Exporters: a trace as Chrome/Perfetto JSON for ui.perfetto.dev, and as CSV that can be read back without loss."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

import numpy as np

from labkit.trace.kinds import CODE, KINDS
from labkit.trace.log import LogError
from labkit.trace.spans import KERNEL, _span_table
from labkit.trace.trace import COLUMNS, Trace

_SPAN_KINDS = ("switch", "begin", "end", "overhead")


def export_chrome(trace: Trace, target: str | os.PathLike | IO[str]) -> None:
    """Write the trace as Chrome trace-event JSON; open the file in ui.perfetto.dev or chrome://tracing.

    Each name is a thread with its spans as complete ("X") events; every other kind of event is an instant ("i") on the thread
    of its task, with `other`, `value` and `extra` as arguments. Times are microseconds from time 0 of the trace.

    Args:
        target: path, or a file open for text.
    """
    us = 1e6 / trace.hz
    names = [*trace.names, KERNEL]
    table = _span_table(trace)
    instants = trace.rows()[~np.isin(trace.kind, [CODE[kind] for kind in _SPAN_KINDS])]
    threads = set(table["name"].tolist()) | set(instants[:, 2].tolist())
    events: list[dict] = [{"ph": "M", "pid": 1, "name": "process_name", "args": {"name": "CPU"}}]
    for code in sorted(threads):
        title = names[code] if code >= 0 else "system"
        events.append({"ph": "M", "pid": 1, "tid": code + 1, "name": "thread_name", "args": {"name": title}})
        events.append({"ph": "M", "pid": 1, "tid": code + 1, "name": "thread_sort_index", "args": {"sort_index": code}})
    order = np.lexsort((table["opened"], table["start"]))
    spans = zip(*(table[key][order].tolist() for key in ("name", "start", "duration", "self", "complete")))
    for name, start, duration, own, complete in spans:
        event = {"ph": "X", "pid": 1, "tid": name + 1, "name": names[name], "ts": start * us, "dur": duration * us}
        events.append({**event, "args": {"self_us": own * us} if complete else {"self_us": own * us, "cut": True}})
    for time, kind, task, other, value, extra in instants.tolist():
        args = {"other": trace.names[other] if other >= 0 else None, "value": value, "extra": extra}
        events.append({"ph": "i", "s": "t", "pid": 1, "tid": task + 1, "name": KINDS[kind], "ts": time * us, "args": args})
    with _opened(target, "w") as file:
        file.write(json.dumps({"displayTimeUnit": "ns", "traceEvents": events}, allow_nan=False))


def export_csv(trace: Trace, target: str | os.PathLike | IO[str]) -> None:
    """Write the trace as CSV: one line of JSON (hz, start, end, names), then a header and one row per event, with names.

    `read_csv` gives the identical trace back; pandas reads it with `pd.read_csv(path, skiprows=1)`.

    Args:
        target: path, or a file open for text with newline="".
    Raises:
        ValueError: a name is empty or appears twice, so that names cannot stand for their codes.
    """
    if "" in trace.names or len(set(trace.names)) < len(trace.names):
        raise ValueError("names in a trace to be exported must be different from each other and not empty")
    names = [*trace.names, ""]  # index -1: none
    with _opened(target, "w") as file:
        head = {"hz": trace.hz, "start": trace.start, "end": trace.end, "names": trace.names}
        file.write("# " + json.dumps(head) + "\r\n")
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        rows = trace.rows().tolist()
        writer.writerows((time, KINDS[kind], names[task], names[other], *rest) for time, kind, task, other, *rest in rows)


def read_csv(source: str | os.PathLike | IO[str]) -> Trace:
    """Read back what `export_csv` wrote.

    Raises:
        LogError: not such a file; names the line and what is wrong with it.
    """
    try:
        with _opened(source, "r") as file:
            head = _head(file.readline())
            names, codes = head["names"], {**{name: i for i, name in enumerate(head["names"])}, "": -1}
            reader = csv.reader(file)
            if tuple(next(reader, ())) != COLUMNS:
                raise LogError(f"line 2 must be {','.join(COLUMNS)}")
            rows = [_row(row, codes, reader.line_num + 1) for row in reader]
        return Trace.from_rows(rows, names, head["hz"], start=head["start"], end=head["end"])
    except OSError as error:
        raise LogError(f"{source}: cannot be read ({error.strerror or error})") from None
    except (UnicodeError, csv.Error, OverflowError) as error:
        raise LogError(f"not a trace as CSV ({error})") from None
    except ValueError as error:
        raise error if isinstance(error, LogError) else LogError(str(error)) from None


def _head(line: str) -> dict:
    try:
        head = json.loads(line.removeprefix("# "))
        numbers = all(type(head[key]) is int for key in ("hz", "start", "end"))
        names = head["names"]
        if numbers and head["hz"] > 0 and all(isinstance(name, str) for name in names) and len(set(names)) == len(names):
            return head
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    raise LogError("line 1 must be '# ' and JSON with hz, start, end and the list of names, as export_csv writes it")


def _row(row: list[str], codes: dict[str, int], line: int) -> tuple[int, ...]:
    try:
        time, kind, task, other, value, extra = row
        return int(time), CODE[kind], codes[task], codes[other], int(value), int(extra)
    except KeyError as error:
        raise LogError(f"line {line}: {error} is no kind of event and no name of line 1") from None
    except ValueError:
        raise LogError(f"line {line}: {','.join(row)[:80]!r} is not {','.join(COLUMNS)}") from None


@contextmanager
def _opened(target: str | os.PathLike | IO[str], mode: str) -> Iterator[IO[str]]:
    if hasattr(target, "write" if mode == "w" else "read"):
        yield target
    else:
        with open(target, mode, encoding="utf-8", newline="") as file:
            yield file
