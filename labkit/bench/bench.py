"""`explore(PriorityInversion)` is a complete bench: controls, picture, cards and the parameters as a line of code.

Knows the `Experiment` contract and nothing of any particular experiment.
"""

from __future__ import annotations

import math
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import ipywidgets as w

from labkit.bench.controls import control, heading, on_grid
from labkit.bench.drop import Drop
from labkit.bench.plot import Plot, cards
from labkit.bench.predict import questions_before
from labkit.experiment import Experiment, Metric, Parameter, ParameterError, Superseded, progress_listener

if TYPE_CHECKING:
    import plotly.graph_objects as go

PROGRESS_EVERY = 0.1  # s between two words on how far a run is


@dataclass(frozen=True)
class Shown:
    """What a bench shows: all four belong together, and it is replaced as a whole."""

    experiment: Experiment[Any]
    result: Any
    figure: dict[str, Any]
    metrics: tuple[Metric, ...]


def show(experiment: Experiment[Any], result: Any) -> Shown:
    """Picture and numbers of a result."""
    return Shown(experiment, result, experiment.figure(result), tuple(experiment.metrics(result)))


def beside(work: Callable[[], None]) -> None:
    """Run a slow experiment without holding up the controls."""
    threading.Thread(target=work, daemon=True).start()


class Bench(w.VBox):
    """Controls, picture and numbers of an experiment, kept up to date. Made by `explore`.

    Whatever asks for a change (a control, a click in the picture, reset, `set`, a slow run that ends) goes through one door, a
    lock, because JupyterLab lets controls speak from another thread than cells. What is shown is one record, replaced only when
    all of it has been computed; a run that has been overtaken by a newer wish, or by a refused one, never shows.

    Attributes:
        controls: the widget of each parameter, by name. They say what is wanted, which is what is shown unless `error` or `busy`.
        plot: the widget of the picture.
    """

    def __init__(self, experiment: Experiment[Any]) -> None:
        self._start = self._wanted = experiment
        self._shown: Shown | None = None
        self._error = ""
        self._door = threading.Condition()
        self._held = self._running = False
        self._number = 0  # of the newest wish; what an older one comes to is dropped
        self._parameters = experiment.parameters()
        self.controls = {p.name: control(p, getattr(experiment, p.name)) for p in self._parameters}
        for each in self.controls.values():
            each.observe(self._moved, names="value")
        self._playable = next((p for p in self._parameters if p.play), None)
        self.plot = Plot(self._answer, self._playable.label if self._playable else "")
        grid = w.Layout(grid_template_columns="repeat(auto-fill, minmax(390px, 1fr))")
        box = w.GridBox(list(self._headed()), layout=grid)
        box.add_class("lab-controls")
        super().__init__([box, self.plot])
        self.add_class("lab-bench")
        questions_before(experiment, self.plot.veil)
        if experiment.slow:
            self._begin(experiment)
        else:  # what fails before anybody moved a control is an error of the cell
            self._replace(show(experiment, experiment.run()))

    def _headed(self) -> Iterator[w.Widget]:
        """The controls, a heading above those of each group, and a place to drop a file below one that names a file."""
        for p in self._parameters:
            if p.group:
                yield heading(p.group)
            yield self.controls[p.name]
            if p.most_bytes is not None:
                yield Drop(partial(setattr, self.controls[p.name], "value"), p.most_bytes)

    @property
    def experiment(self) -> Experiment[Any]:
        """The parameters of what is shown; before the first run has ended, those asked for."""
        return self._shown.experiment if self._shown else self._wanted

    @property
    def result(self) -> Any:
        """The result shown; None before the first run has ended."""
        return self._shown and self._shown.result

    @property
    def spec(self) -> dict[str, Any]:
        """The figure shown, as a dict with `data` and `layout`; empty before the first run has ended."""
        return self._shown.figure if self._shown else {"data": [], "layout": {}}

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The numbers shown."""
        return self._shown.metrics if self._shown else ()

    @property
    def error(self) -> str:
        """What is wrong with what the controls ask for; '' if nothing is."""
        return self._error

    @property
    def busy(self) -> bool:
        """Whether a slow run is under way."""
        return self._running

    def to_figure(self) -> go.Figure:
        """The figure shown as one of plotly's own, for saving or changing it."""
        import plotly.graph_objects as go

        return go.Figure(self.spec)

    def wait(self, timeout: float | None = None) -> bool:
        """Block until no run is under way; False if that takes longer than `timeout` seconds."""
        with self._door:
            return self._door.wait_for(lambda: not self._running, timeout)

    def set(self, **values: Any) -> None:
        """Move several controls at once; the picture is drawn once, and the page gets it before it moves its sliders. Raises
        ParameterError and moves nothing if a value is not allowed.
        """
        with self._door, ExitStack() as sliders:
            self._wanted.replace(**values)
            self._held = True
            try:
                for name, value in values.items():
                    sliders.enter_context(self.controls[name].hold_sync())
                    self.controls[name].value = value
            finally:
                self._held = False
            self._update()

    def reset(self) -> None:
        """All parameters back to where this bench started."""
        self.set(**{name: getattr(self._start, name) for name in self.controls})

    def _ipython_display_(self) -> None:
        """The bench, and a sentence that only a page shows which has lost it (see plot.css)."""
        from IPython.display import display

        lost = "This bench was here while its kernel ran. Run the cell again (Shift+Enter) to get it back."
        page = f'<div class="lab-lost" style="border-left:6px solid #D55E00;padding:6px 12px">{lost}</div>'
        display({"text/html": page, "text/plain": lost}, raw=True)
        display(self._repr_mimebundle_(), raw=True)

    # The door

    def _moved(self, _: Any) -> None:
        """A control has another value, or the page says again what it was told, as 5.000000000000001: that is nothing new."""
        with self._door:
            if not self._held and (self._error or self._asked() != self._wanted.model_dump()):
                self._update()

    def _answer(self, content: Mapping[str, Any]) -> None:
        """A click, a zoom, a step of what plays, or a reset in the page."""
        with self._door:
            try:
                match content:
                    case {"reset": True}:
                        self.reset()
                    case {"click": [int(trace), int(point)]}:
                        self.set(**self.spec["data"][trace]["meta"]["set"][point])
                    case {"range": edges}:
                        self._zoom(edges)
                    case {"step": int(steps)}:
                        self._go(steps)
            except (ParameterError, LookupError) as error:  # a click on a picture that is no longer the one shown, for example
                self._refuse(error)

    def _zoom(self, edges: Sequence[float] | None) -> None:
        """Set the parameters that the x axis stands for, within their bounds; None is the whole axis."""
        names = self.spec["layout"]["meta"]["range"]
        first, last = (next(p for p in self._parameters if p.name == name) for name in names)
        low, high = edges or (-math.inf, math.inf)
        self.set(**{first.name: _within(first, low), last.name: _within(last, high)})

    def _go(self, steps: int) -> None:
        """What plays goes some steps forward, if negative back, and with 0 to its beginning."""
        p = self._playable
        if p is not None:
            assert p.low is not None, "what plays is a number"
            wanted = self.controls[p.name].value + steps * (p.step or 1) if steps else p.low
            self.set(**{p.name: _within(p, wanted)})

    def _asked(self) -> dict[str, Any]:
        """What the controls say, by parameter."""
        return {p.name: on_grid(p, self.controls[p.name].value) for p in self._parameters}

    def _update(self) -> None:
        """Get what the controls ask for: from the result there is, if only its view changes, else from a new run."""
        try:
            wanted = self._start.replace(**self._asked())
            if self._running and wanted.same_run(self._wanted):
                self._wanted = wanted  # the run under way is the right one
                return
            self._wanted = wanted
            self._overtake()
            if self._shown and wanted.same_run(self._shown.experiment):
                self._replace(show(wanted, self._shown.result))
            elif wanted.slow:
                self._begin(wanted)
            else:
                self._replace(show(wanted, wanted.run()))
        except Exception as error:  # the boundary to the person at the slider: shown, with its place, never swallowed
            self._overtake()
            self._refuse(error)

    def _overtake(self) -> None:
        """Whatever is under way is not awaited any more."""
        self._number += 1
        self._running = False
        self._door.notify_all()

    def _begin(self, experiment: Experiment[Any]) -> None:
        """Run beside the controls; the result comes back through the door."""
        self._number, self._running = self._number + 1, True
        number = self._number
        self._error = ""
        self.plot.tell(progress=0.0)
        said = time.monotonic()

        def listen(fraction: float) -> None:
            nonlocal said
            with self._door:
                if number != self._number:
                    raise Superseded
                if time.monotonic() - said > PROGRESS_EVERY:
                    said = time.monotonic()
                    self.plot.tell(progress=fraction)

        def work() -> None:
            ours = progress_listener.set(listen)
            try:
                result, failure = experiment.run(), None
            except Superseded:
                return
            except Exception as error:
                result, failure = None, error
            finally:
                progress_listener.reset(ours)
            with self._door:
                if number == self._number:
                    self._overtake()
                    self._end(result, failure)

        beside(work)

    def _end(self, result: Any, failure: Exception | None) -> None:
        try:
            if failure is not None:
                raise failure
            self._replace(show(self._wanted, result))  # another view may have been asked for meanwhile
        except Exception as error:
            self._refuse(error)

    def _replace(self, shown: Shown) -> None:
        self._shown, self._error = shown, ""
        experiment, idle = shown.experiment, shown.experiment.without_effect()
        for name, each in self.controls.items():
            each.disabled = name in idle
        self.plot.show(
            shown.figure,
            cards(shown.metrics, experiment.headline),
            experiment.code(),
            idle={p.label: idle[p.name] for p in self._parameters if p.name in idle},
            ended=self._ended(shown),
        )

    def _ended(self, shown: Shown) -> bool:
        """Whether what plays is at its end, or at that of the picture."""
        p = self._playable
        meta = shown.figure["layout"].get("meta") or {}
        return p is not None and (getattr(shown.experiment, p.name) >= p.high or bool(meta.get("ended")))

    def _refuse(self, error: Exception) -> None:
        self._error = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        where = "" if isinstance(error, ParameterError) else "".join(traceback.format_exception(error))
        self.plot.tell(self._error, where)


def _within(p: Parameter, value: float) -> Any:
    """The nearest allowed value of a number."""
    assert p.low is not None and p.high is not None, "a number has bounds"
    step = p.step or (1 if p.type is int else None)
    value = min(max(value, p.low), p.high)
    return p.type(round(round(value / step) * step, 9) if step else value)


def explore(experiment: type[Experiment[Any]] | Experiment[Any], **values: Any) -> Bench:
    """A bench for an experiment: a control for each parameter, the picture kept up to date, cards, reset, the parameters as code.

    `values` are the positions the bench starts (and resets) to. Raises ParameterError for a name or value that is not allowed.
    """
    return Bench(experiment(**values) if isinstance(experiment, type) else experiment.replace(**values))
