"""What comes from outside: files up to a stated size, JSON without surprises, data checked against a pydantic model.

Every mistake is a ValueError of one sentence that says what is wrong, where, and what is allowed. A model of outside data takes
its types from here, or declares them with a `Field(description=...)` that says what is allowed, as in "a whole number".
"""

from __future__ import annotations

import json
import os
import stat
import unicodedata
from collections.abc import Iterator, Mapping
from typing import IO, Annotated, Any, NoReturn, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, Field, ValidationError
from pydantic.fields import FieldInfo

from labkit.checks import UNBOUNDED, shown, whole_words

#: Largest file of JSON or chain CSV that is read; one of this size takes below half a gigabyte of memory.
MOST_BYTES = 8 << 20

Model = TypeVar("Model", bound=BaseModel)


def _printable(name: str) -> str:
    if not name.isprintable():  # nor is a line separator, a change of writing direction, half a surrogate
        raise ValueError("control characters")
    return name


#: Longest name.
MOST_IN_NAME = 100

#: A name that can stand in a line of output as it is.
Name = Annotated[
    str,
    AfterValidator(_printable),
    Field(strict=True, min_length=1, max_length=MOST_IN_NAME, description=f"a text of 1 to {MOST_IN_NAME} printable characters"),
]


def a_whole(least: int, most: int = UNBOUNDED) -> Any:
    """Declares that a field is a whole number from `least` to `most`, both included; true, 2.0 and "2" are none."""
    return Field(strict=True, ge=least, le=most, description=whole_words(least, most))


def a_list(of: str, most: int, least: int = 0) -> Any:
    """Declares that a field is a list of `least` to `most` entries; `of` says what they are."""
    words = f"a list of {f'{least} to {most}' if least else f'at most {most}'} {of}"
    return Field(min_length=least, max_length=most, fail_fast=True, description=words)


def one_line(text: str) -> str:
    """The text with everything that could break or turn around its line written as an escape."""
    hidden = ("Cc", "Cf", "Cs", "Zl", "Zp")
    return "".join(ascii(c)[1:-1] if unicodedata.category(c) in hidden else c for c in text)


def with_an_end(file: IO[bytes]) -> IO[bytes]:
    """The open file; ValueError for a device or pipe, as an archive is read from its end, which may never come."""
    try:
        mode = os.fstat(file.fileno()).st_mode
    except OSError:  # bytes in memory
        return file
    if not stat.S_ISREG(mode):
        raise ValueError("it is a device or pipe; an archive must be a file on a disk")
    return file


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a UTF-8 file, line ends as they are; ValueError if it is none or longer than `MOST_BYTES`, OSError."""
    with open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path} is longer than {MOST_BYTES >> 20} MiB, the largest file that is read")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: byte {error.start} is 0x{data[error.start]:02x}") from None


def read_json(path: str | os.PathLike[str]) -> Any:
    """The JSON value in a file; ValueError if it is none (NaN is none, nor is a key that comes twice) or too long, OSError."""
    return json_value(read_text(path), str(path))


def json_value(text: str, name: str) -> Any:
    """The JSON value that a text is; ValueError as `read_json`, in which `name` says what was read."""
    try:
        return json.loads(text, parse_constant=_no_number, object_pairs_hook=_object)
    except RecursionError:
        raise ValueError(f"{name} is not JSON that can be read: it is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{name} is not JSON: {error}") from None


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        keys = set()
        for key, _ in pairs:
            if key in keys:
                raise ValueError(f"the key {shown(key)} comes twice in one object")
            keys.add(key)
    return made


def checked(model: type[Model], data: Any, what: str) -> Model:
    """`data` as an instance of `model`; ValueError for the first thing wrong with it. `what` names the whole: "the task set"."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
    raise ValueError(_sentence(model, data, first, what))


def _sentence(model: type[BaseModel], data: Any, error: Mapping[str, Any], what: str) -> str:
    """The error in words, its place as in: config: cores; task 'A': priority; task 3, if it has no name; task 'A': time 2."""
    field: FieldInfo | None = None
    inner: type[BaseModel] | None = model
    steps: list[str] = []
    for key in error["loc"]:
        data = data[key] if not isinstance(data, Mapping) or key in data else None
        if isinstance(key, int):
            name = data.get("name") if isinstance(data, Mapping) and error["loc"][-1] != "name" else None
            steps[-1] = f"{steps[-1].removesuffix('s')} {shown(name) if isinstance(name, str) else key}"
            field = _item(field.annotation) if field else None
        elif inner:
            steps.append(key)
            model, field = inner, inner.model_fields.get(key)
            inner = next(_models(field.annotation), None) if field else None
    owner, last = ": ".join(steps[:-1]) or what, steps[-1] if steps else ""
    allowed = field.description if field and field.description else "an object"
    match error["type"]:
        case "extra_forbidden":
            return f"{owner} has a field {shown(last)}; there are {', '.join(model.model_fields)}"
        case "missing":
            return f"{owner} has no {last}; {allowed} is needed"
        case "too_long":
            return f"{owner} has {len(data)} {last}; {allowed} is allowed"
    return f"{': '.join(steps) or what} is {shown(error['input'])}; {allowed} is allowed"


def _item(annotation: Any) -> FieldInfo | None:
    """What a type such as `list[Annotated[int, whole(1)]] | None` says of a single item; None if the items are objects."""
    for argument in get_args(annotation):
        said = (known for known in getattr(argument, "__metadata__", ()) if isinstance(known, FieldInfo))
        if found := next(said, None) or _item(argument):
            return found
    return None


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models in a type such as `tuple[Task, ...] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)
