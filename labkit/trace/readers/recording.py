"""`read_recording`: whatever the recording is, recognised by its content."""

from __future__ import annotations

import os
import re
from io import BytesIO, StringIO
from typing import IO, Any

from labkit.trace.readers.btf import btf_of, is_btf
from labkit.trace.readers.chrome import chrome_of
from labkit.trace.readers.files import read_csv, read_npz
from labkit.trace.readers.ftrace import ftrace_of, is_ftrace
from labkit.trace.readers.log import log_of
from labkit.trace.readers.report import LogError, Problems, Report
from labkit.trace.readers.source import Source, open_source
from labkit.trace.trace import Trace

#: So many lines are looked at.
LOOKED_AT = 1000


def read_recording(source: str | os.PathLike[str] | bytes | IO[Any], *, clock_hz: float | None = None) -> tuple[Trace, Report]:
    """Read a recording of tasks; return the trace and a report of what was repaired or left out.

    Recognised by content, whatever the name: the lab's own CSV, npz and JSON; JSON of trace events (Chrome, Perfetto); BTF;
    ftrace's text; and, if it is none of these, a log of stamps (see `read_log`).

    Args:
        source: a path, an open file (text or binary), bytes or text. At most `labkit.trace.readers.source.MOST_BYTES`.
        clock_hz: of the 32-bit counter behind the stamps of a log, see `read_log`; no other format has one.

    Raises:
        LogError: there is nothing to read, in one sentence.
    """
    with open_source(source) as opened:
        sort = recognised(opened)
        if sort == "log":
            return log_of(opened, clock_hz)
        if clock_hz is not None:
            raise LogError(f"{opened.title}: this is {sort}, whose times do not wrap; a clock belongs to a log of stamps only")
        match sort:
            case "ftrace":
                return ftrace_of(opened)
            case "BTF":
                return btf_of(opened)
            case "JSON":
                return chrome_of(opened)
            case "CSV":
                trace = read_csv(StringIO(opened.text(), newline=""))
            case _:
                trace = read_npz(BytesIO(opened.bytes()))
        return trace, Report.of(opened.title, len(trace.cores()), Problems(), f"lab {sort}", len(trace))


def recognised(source: Source) -> str:
    """What its beginning looks like: "npz", "CSV", "JSON", "BTF", "ftrace" or else "log"."""
    if isinstance(source.head, bytes) and source.head.startswith(b"PK\x03\x04"):
        return "npz"
    lines = source.beginning()[:LOOKED_AT]
    text = "\n".join(lines[:3]).lstrip()
    if re.match(r"# \{.*\}\r?\n?time,kind,", text):
        return "CSV"
    if re.match(r"\{\s*\"|\[\s*[{\]]|\{\s*\}", text):
        return "JSON"
    if is_btf(lines):
        return "BTF"
    return "ftrace" if is_ftrace(lines) else "log"
