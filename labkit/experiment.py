"""The one idea of the lab: an experiment is a validated set of parameters, a pure run, a figure and metrics.

    class Braking(Experiment):
        "How far does the robot roll on?"
        speed: Annotated[int, Interval(ge=100, le=900), Unit("mm/s"), Doc("speed when the brake comes")] = 500

        def run(self): return self.speed**2 / 2000
        def figure(self, result): return {"data": [...], "layout": {...}}
        def metrics(self, result): return [Metric("distance", result, "mm")]

From this declaration follow the widgets (`labkit.bench`), the command line (`labkit run braking --set speed=300`),
validation with errors that name field, bound and unit, the hypothesis strategy for tests, and sweeps.
"""

from __future__ import annotations

import contextvars
import html
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Generic, Literal, Self, TypeVar, get_args, get_origin

import annotated_types as at
from pydantic import BaseModel, ConfigDict, ValidationError
from typing_extensions import Doc

T = TypeVar("T")
R = TypeVar("R")


class ParameterError(ValueError):
    """A parameter that does not exist or a value that is not allowed; the message is one sentence that says what is."""


class Superseded(Exception):
    """Raised inside `progress` when nobody waits for this run any more; never seen outside `explore`."""


@dataclass(frozen=True)
class View:
    """Marks a parameter that only changes how a result is shown: a step, a time cursor, a choice of panel. It never simulates.

    Attributes:
        play: whether it is a step or a time that a reader goes through: the bench then has buttons for back, play and forward.
    """

    play: bool = False


@dataclass(frozen=True)
class OfAFile:
    """Marks a text that names a file: a bench then has a place to drop one of at most `most` bytes."""

    most: int


@dataclass(frozen=True)
class Group:
    """Begins a group of parameters: a bench writes this heading above the one so marked and those behind it."""

    heading: str


@dataclass(frozen=True)
class Labels:
    """Text shown for the choices of a parameter, where the bare values would not explain themselves."""

    text: Mapping[Any, str]

    def __hash__(self) -> int:
        return hash(tuple(self.text.items()))


@dataclass(frozen=True)
class Metric:
    """One number of a result.

    Attributes:
        name, value, unit: what is shown; `value` may be None (not defined, the `note` says why), a number, a bool or text.
        bound: what analysis says the value can never exceed, in the same unit.
        published: the value printed in the source, where there is one, in the same unit.
        good: True or False where the number keeps or breaks a promise, None where it is just a number.
        note: one line of explanation.
    """

    name: str
    value: float | int | str | bool | None
    unit: str = ""
    bound: float | int | None = None
    published: float | int | str | None = None
    good: bool | None = None
    note: str = ""

    def text(self) -> str:
        """Value and unit as a reader wants them: at most four significant digits after the point, thousands apart."""
        return f"{_number(self.value)} {self.unit}".strip()


def _number(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1000 else f"{value:,.0f}".replace(",", "\u202f")
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    return str(value)


@dataclass(frozen=True)
class Parameter:
    """What a control, a command line or a test needs to know of one field."""

    name: str
    type: type
    default: Any
    doc: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    step: float | None = None
    choices: tuple[Any, ...] = ()
    labels: Mapping[Any, str] | None = None
    max_length: int | None = None
    most_bytes: int | None = None
    view: bool = False
    play: bool = False
    group: str = ""

    @property
    def label(self) -> str:
        """The field's name as words: `hold_time` reads 'hold time'."""
        return self.name.replace("_", " ")

    def allowed(self) -> str:
        """The values allowed, in words: '1 to 20 ms', 'one of semaphore, mutex'."""
        if self.choices:
            return "one of " + ", ".join(map(str, self.choices))
        if self.type is bool:
            return "true or false"
        if self.type is str:
            return "text" if self.max_length is None else f"text of at most {self.max_length} characters"
        bounds = f"{self.low} to {self.high}" if self.low is not None and self.high is not None else "any number"
        step = f" in steps of {self.step}" if self.step not in (None, 1) else ""
        return f"{'a whole number, ' if self.type is int else ''}{bounds} {self.unit}".rstrip() + step


def _parameter(name: str, field: Any) -> Parameter:
    known: dict[str, Any] = {}
    for item in field.metadata:
        match item:
            case at.Ge():
                known["low"] = item.ge
            case at.Le():
                known["high"] = item.le
            case at.Interval():
                known |= {"low": item.ge, "high": item.le}
            case at.MultipleOf():
                known["step"] = item.multiple_of
            case at.Unit():
                known["unit"] = item.unit
            case at.MaxLen():
                known["max_length"] = item.max_length
            case Doc():
                known["doc"] = item.documentation
            case Labels():
                known["labels"] = item.text
            case OfAFile():
                known["most_bytes"] = item.most
            case Group():
                known["group"] = item.heading
            case View():
                known |= {"view": True, "play": item.play}
    kind = field.annotation
    if get_origin(kind) is Literal:
        known["choices"] = get_args(kind)
        kind = type(known["choices"][0])
    if "doc" not in known:
        raise TypeError(f"parameter {name} has no Doc('...') that says what it is")
    if kind in (int, float) and not known.get("choices") and not {"low", "high"} <= known.keys():
        raise TypeError(f"parameter {name} has no bounds; give it Interval(ge=..., le=...)")
    return Parameter(name=name, type=kind, default=field.default, **known)


class Experiment(BaseModel, Generic[R]):
    """Base of all experiments; `R` is the type of the result. Fields are the parameters; every one has a default, bounds, a unit
    where it has one, and a `Doc`.

    Every combination of allowed values must run: a bench has no forbidden slider positions. The names of the metrics are the
    same for all of them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)

    #: True for a run above about 200 ms: `explore` runs it beside the widgets, shows `progress`, and drops it for a newer value.
    slow: ClassVar[bool] = False
    #: Names of the metrics, at most three, that stand above the picture; none given: the first three. The others fold away.
    headline: ClassVar[tuple[str, ...]] = ()

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise self._refused(error) from None

    @classmethod
    def model_validate(cls, obj: Any, **how: Any) -> Self:
        """pydantic's own door, with the errors of this one. Raises ParameterError."""
        try:
            return super().model_validate(obj, **how)
        except ValidationError as error:
            raise cls._refused(error) from None

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy; changes are validated, which pydantic leaves out. Raises ParameterError."""
        return self.replace(**(update or {}))

    def replace(self, **changes: Any) -> Self:
        """The same experiment with other values of some parameters: the only way to a neighbour. Raises ParameterError."""
        return type(self)(**{**self.model_dump(), **changes})

    def same_run(self, other: Experiment[Any]) -> bool:
        """Whether the other one has the same result: it differs at most in how that is shown, in parameters marked `View`."""
        return type(self) is type(other) and all(
            getattr(self, p.name) == getattr(other, p.name) for p in self.parameters() if not p.view
        )

    @classmethod
    def _refused(cls, error: ValidationError) -> ParameterError:
        return ParameterError("; ".join(cls._sentence(e) for e in error.errors()))

    @classmethod
    def _sentence(cls, error: Mapping[str, Any]) -> str:
        where = ".".join(map(str, error["loc"]))
        known = {p.name: p for p in cls.parameters()}
        if error["type"] == "extra_forbidden":
            return f"{cls.name()} has no parameter {where!r}; it has {', '.join(known)}"
        if where in known:
            return f"{cls.name()}: {where} = {error['input']!r} is not allowed; allowed is {known[where].allowed()}"
        return f"{cls.name()}: {error['msg'].removeprefix('Value error, ')}"

    @classmethod
    def name(cls) -> str:
        """The name on the command line: PriorityInversion is `priority-inversion`."""
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", cls.__name__).lower()

    @classmethod
    def title(cls) -> str:
        """First line of the docstring."""
        return (cls.__doc__ or cls.__name__).strip().splitlines()[0]

    @classmethod
    @cache
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared fields, in order."""
        return tuple(_parameter(name, field) for name, field in cls.model_fields.items())

    @classmethod
    def strategy(cls) -> Any:
        """A hypothesis strategy that draws whole experiments, every parameter from its allowed values."""
        from hypothesis import strategies as st

        def values(p: Parameter) -> Any:
            if p.choices:
                return st.sampled_from(p.choices)
            if p.type is bool:
                return st.booleans()
            if p.type is str:
                return st.just(p.default)  # free text has a grammar of its own, fuzzed where that grammar is
            assert p.low is not None and p.high is not None, "a number has bounds"
            if p.step is not None or p.type is int:
                step = p.step or 1
                first, last = -(-p.low // step), p.high // step
                return st.integers(int(first), int(last)).map(lambda n: p.type(n * step))
            return st.floats(p.low, p.high)

        return st.builds(cls, **{p.name: values(p) for p in cls.parameters()})

    def code(self) -> str:
        """This experiment as a line of Python that makes it again; parameters at their default are left out."""
        changed = [(p, getattr(self, p.name)) for p in self.parameters()]
        return f"{type(self).__name__}({', '.join(f'{p.name}={v!r}' for p, v in changed if v != p.default)})"

    def run(self) -> R:
        """The result; a pure function of the parameters that are not marked `View`."""
        raise NotImplementedError

    def figure(self, result: R) -> dict[str, Any]:
        """A plotly figure as a dict with `data` and `layout`, drawn from the result; simulates nothing. The same number and types
        of traces for every result.

        A trace whose points can be clicked carries `meta={"set": [...]}`, for each point the parameters that a click on it sets.
        A layout with `meta={"range": (first, last)}` names the two parameters that a zoom or pan of the x axis sets, one with
        `meta={"says": text}` has a sentence that stands above the picture: what happens at the step or time it shows; with
        `"ended": True` beside it there is nothing more to play. One with `meta={"told": text}` has a page of text, folded away
        below the picture.
        """
        raise NotImplementedError

    def without_effect(self) -> Mapping[str, str]:
        """Parameters that change nothing in this position, and when they do, in words: `{"edge": "for a matrix only"}`. A bench
        greys their controls.
        """
        return {}

    def metrics(self, result: R) -> Sequence[Metric]:
        """The numbers of the result that are worth a line."""
        raise NotImplementedError

    def values(self) -> dict[str, Any]:
        """All metrics of one run, by name."""
        return {metric.name: metric.value for metric in self.metrics(self.run())}

    def measure(self, metric: str) -> Any:
        """Run and return the value of one metric by its name."""
        found = self.values()
        if metric not in found:
            raise ParameterError(f"{self.name()} has no metric {metric!r}; it has {', '.join(found)}")
        return found[metric]


#: Set by whoever shows progress; called with the fraction done, it may raise `Superseded`.
progress_listener: contextvars.ContextVar[Callable[[float], None]] = contextvars.ContextVar(
    "progress", default=lambda fraction: None
)


def progress(items: Iterable[T], total: int | None = None) -> Iterator[T]:
    """Iterate inside a slow `run`; whoever shows the run learns how far it is and can stop it here."""
    if total is None:
        items = list(items)
        total = len(items)
    tell = progress_listener.get()
    for done, item in enumerate(items):
        tell(done / total)
        yield item
    tell(1.0)


@dataclass(frozen=True)
class Feedback:
    """What the model says of an answer to an exercise."""

    solved: bool
    text: str

    def __str__(self) -> str:
        return f"{'Solved' if self.solved else 'Not yet'}: {self.text}"

    def _repr_html_(self) -> str:
        colour, mark = ("#009E73", "✓") if self.solved else ("#D55E00", "✗")
        style = f"border-left:6px solid {colour};padding:6px 12px;font-size:1.1em"
        return f'<p style="{style}"><b>{mark}</b> {html.escape(self.text)}</p>'
