"""The command line: every experiment without a notebook, and the models' file formats; its commands are in `labkit.commands`.

Exit code 0: done; 1: an error in the input, told in one sentence on standard error; 2: wrong usage; 130: interrupted.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from labkit.commands import parser
from labkit.outside import one_line


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of `labkit`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="labkit.plain")  # no character is worth a traceback, whatever the terminal
    args = parser().parse_args(argv)
    try:
        if sys.stdout is None:
            raise OSError("standard output is closed")
        args.function(args)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        _drop_output()
    except KeyboardInterrupt:
        return _fail(args.command, "interrupted", 130)
    except MemoryError:
        return _fail(args.command, "the input needs more memory than there is", 1)
    except OSError as error:
        return _fail(args.command, f"{error.filename}: {error.strerror}" if error.filename else str(error), 1)
    except ValueError as error:
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
        return _fail(args.command, f"{error}{notes}", 1)
    return 0


def _fail(command: str, message: str, code: int) -> int:
    if sys.stderr is not None:
        print(f"labkit {command}: {one_line(message)}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _drop_output()
    return code


def _drop_output() -> None:
    """Lets go of what cannot be written, so that the interpreter does not try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _plain(error: UnicodeError) -> tuple[str, int]:
    """What to write for characters that an encoding does not have: a blank for a thin one, else an escape."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return text.replace("\u202f", " ").encode("ascii", "backslashreplace").decode("ascii"), error.end


codecs.register_error("labkit.plain", _plain)


if __name__ == "__main__":
    sys.exit(main())
