"""Widgets from an experiment's declaration: `explore(PriorityInversion)` is a complete bench.

Knows the `Experiment` contract and nothing of any particular experiment.
"""

from __future__ import annotations

import functools
import html
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import anywidget
import ipywidgets as w
import numpy as np
import plotly.graph_objects as go
import traitlets

from labkit.experiment import Experiment, Metric, Parameter, ParameterError, Superseded, progress_listener

STYLE = """
.lab-bench {border: 1px solid #d0d7de; border-radius: 8px; padding: 10px 14px; overflow: hidden;}
.lab-bench select {font-size: 14px;}
.lab-bench .lab-controls {gap: 0 18px; overflow: hidden;}
.lab-bench .lab-controls .widget-text {grid-column: 1 / -1;}
.lab-bench .widget-label, .lab-bench .widget-readout {font-size: 15px;}
.lab-bench .lab-metrics {display: flex; flex-wrap: wrap; gap: 8px; line-height: 1.25;}
.lab-bench .lab-metric {border-left: 5px solid #8c959f; background: #f6f8fa; padding: 4px 12px; border-radius: 4px;}
.lab-bench .lab-metric b {font-size: 20px; display: block; white-space: nowrap; color: #1f2328;}
.lab-bench .lab-metric span {font-size: 13px; color: #424a53;}
.lab-bench .lab-good {border-left-color: #009E73;}
.lab-bench .lab-bad {border-left-color: #D55E00;}
.lab-bench .lab-error {border-left: 6px solid #D55E00; background: #fff4ee; padding: 6px 12px; font-size: 15px; color: #1f2328;}
.lab-bench .lab-code {font-size: 13px; color: #57606a;}
.lab-lecture .widget-label, .lab-lecture .widget-readout, .lab-lecture .lab-error, .lab-lecture button, .lab-lecture select {font-size: 21px !important;}
.lab-lecture .lab-metric b {font-size: 30px;}
.lab-lecture .lab-metric span {font-size: 18px;}
.lab-lecture .lab-code {font-size: 18px;}
.lab-lecture .lab-controls {grid-template-columns: repeat(auto-fill, minmax(560px, 1fr)) !important;}
.lab-lecture .widget-label {min-width: 270px;}
.lab-lecture .noUi-handle {transform: scale(1.5);}
.lab-lecture .widget-hslider, .lab-lecture .widget-dropdown, .lab-lecture .widget-checkbox {height: 40px; line-height: 40px;}
"""

LECTURE_SCALE = 1.45
FONT = 15


class Fit(anywidget.AnyWidget):
    """Invisible; brings the style of the bench and tells plotly, which only listens to the window, when the bench changes its width.

    It also notices a figure that arrived empty, which happens to the first ones of a page, and reports it.
    """

    _css = STYLE
    _esm = """
    export default { render({ model, el }) {
        let width = 0, reported = null;
        const check = (tries) => {
            window.dispatchEvent(new Event("resize"));
            const plot = el.closest(".lab-bench")?.querySelector(".js-plotly-plot");
            const empty = plot?.data?.length === 0;
            if (empty && plot !== reported) {  // its content came while the page was still loading what draws it
                reported = plot;
                model.send({ empty: true });
            }
            const drawn = plot?.querySelector(".main-svg")?.clientWidth ?? 0;
            if (el.isConnected && tries && (empty || Math.abs(drawn - width) > 40)) setTimeout(check, 250, tries - 1);
        };
        const observer = new ResizeObserver(([box]) => {
            if (box.contentRect.width === width) return;
            width = box.contentRect.width;
            requestAnimationFrame(() => check(80));
        });
        observer.observe(el);
        return () => observer.disconnect();
    } };
    """


class Plotly(anywidget.AnyWidget):
    """Invisible; brings plotly's code, 5 MB, to the page once. A FigureWidget of its own accord brings it once per figure."""

    code = traitlets.Unicode().tag(sync=True)
    _esm = """
    export default { initialize({ model }) {
        const url = URL.createObjectURL(new Blob([model.get("code")], { type: "text/javascript" }));
        import(url).then((module) => {
            window.labkitPlotly = module.default;
            window.dispatchEvent(new Event("labkit-plotly"));
        });
    } };
    """


@functools.cache
def _plotly() -> Plotly:
    """The one carrier of this process."""
    return Plotly(code=str(go.FigureWidget._esm))


class Figure(go.FigureWidget):
    """A FigureWidget that waits for the code `Plotly` brings, however long the page needs for it, and starts from its content then."""

    _esm = """
    const arrived = () => new Promise((resolve) => {
        if (window.labkitPlotly) resolve(window.labkitPlotly);
        else window.addEventListener("labkit-plotly", () => resolve(window.labkitPlotly), { once: true });
    });
    export default () => {
        let figure;
        return { async render(context) {
            const make = await arrived();
            if (!figure) {
                figure = make();
                figure.initialize(context);
            }
            return figure.render(context);
        } };
    };
    """

    def __init__(self, spec: dict[str, Any]) -> None:
        _plotly()
        super().__init__(spec)
        self._config = {**self._config, "responsive": True, "displaylogo": False}


def control(p: Parameter, value: Any) -> w.Widget:
    """The widget for one parameter: slider for a number, drop-down for a choice, box for a switch, field for text."""
    unit = f" [{p.unit}]" if p.unit else ""
    common: dict[str, Any] = {
        "value": value,
        "description": p.label + unit,
        "tooltip": p.doc,
        "style": {"description_width": "190px"},
        "layout": w.Layout(width="auto"),
    }
    if p.choices:
        labels = p.labels or {}
        made: w.Widget = w.Dropdown(options=[(str(labels.get(c, c)), c) for c in p.choices], **common)
    elif p.type is bool:
        made = w.Checkbox(indent=True, **common)
    elif p.type is int:
        made = w.IntSlider(min=int(p.low), max=int(p.high), step=int(p.step or 1), **common)
    elif p.type is float:
        step = p.step or (p.high - p.low) / 100
        digits = max(0, -int(np.floor(np.log10(step) + 1e-9))) if step < 1 else 0
        made = w.FloatSlider(min=p.low, max=p.high, step=step, readout_format=f".{digits}f", **common)
    else:
        common["layout"] = w.Layout(width="auto", grid_column="1 / -1")
        made = w.Text(continuous_update=False, **common)
    made.add_class(f"lab-{p.name.replace('_', '-')}")
    return made


def metrics_html(metrics: Sequence[Metric]) -> str:
    """The metrics as a strip of cards, published values beside the model's."""

    def card(m: Metric) -> str:
        kind = {True: " lab-good", False: " lab-bad", None: ""}[m.good]
        beside = "".join(
            f" · {word} {html.escape(Metric('', value, m.unit).text())}"
            for word, value in (("bound", m.bound), ("published", m.published))
            if value is not None
        )
        return (
            f'<div class="lab-metric{kind}" title="{html.escape(m.note)}"><b>{html.escape(m.text())}</b>'
            f"<span>{html.escape(m.name)}{beside}</span></div>"
        )

    return f'<div class="lab-metrics">{"".join(map(card, metrics))}</div>'


def changes(old: Mapping[str, Any], new: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths such as `marker_color` whose value differs between two figure dicts, with the new value (None: no longer there)."""
    for key in [*new, *(k for k in old if k not in new)]:
        before, after = old.get(key), new.get(key)
        if isinstance(before, Mapping) and isinstance(after, Mapping):
            yield from changes(before, after, f"{path}{key}_")
        elif not _same(before, after):
            yield f"{path}{key}", after


def _same(a: Any, b: Any) -> bool:
    if a is b:
        return True
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.shape(a) == np.shape(b) and bool(np.all(np.asarray(a) == np.asarray(b)))
    return type(a) is type(b) and a == b


class Bench(w.VBox):
    """Controls, metrics and one FigureWidget of an experiment, kept up to date. Made by `explore`.

    Attributes:
        experiment: the parameters shown now.
        result: the result shown now (None before the first run has ended).
        controls: the widget of each parameter, by name.
        figure: the FigureWidget; None before the first run has ended, then the same object for the life of the bench.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment, self.result = experiment, None
        self._start, self._shown = experiment, None
        self._held = self._lecture = False
        self._run_id, self._lock = 0, threading.Lock()
        self.controls = {p.name: control(p, getattr(experiment, p.name)) for p in experiment.parameters()}
        for c in self.controls.values():
            c.observe(self._changed, names="value")
        self._metrics, self._error, self._code = w.HTML(), w.HTML(), w.HTML()
        self._error.add_class("lab-error-slot")
        self._progress = w.FloatProgress(min=0, max=1, layout=w.Layout(width="160px", visibility="hidden"))
        reset = w.Button(
            description="Reset",
            tooltip="all parameters back to where this bench started",
            layout=w.Layout(width="auto", flex="0 0 auto"),
        )
        reset.add_class("lab-reset")
        reset.on_click(lambda _: self.set(**{n: getattr(self._start, n) for n in self.controls}))
        lecture = w.ToggleButton(
            description="Lecture mode",
            tooltip="everything larger, for the last row",
            layout=w.Layout(width="auto", flex="0 0 auto"),
        )
        lecture.add_class("lab-lecture-switch")
        lecture.observe(lambda change: self._enlarge(change["new"]), names="value")
        self.figure: Figure | None = None
        controls = w.GridBox(
            list(self.controls.values()), layout=w.Layout(grid_template_columns="repeat(auto-fill, minmax(390px, 1fr))")
        )
        controls.add_class("lab-controls")
        self._metrics.layout = w.Layout(flex="1 1 auto")
        bar = w.HBox([self._metrics, self._progress, reset, lecture], layout=w.Layout(align_items="center"))
        fit = Fit()
        fit.on_msg(lambda *_: self._make_figure())
        super().__init__([fit, controls, self._error, bar, self._code])
        self.add_class("lab-bench")
        if experiment.slow:
            self._update()
        else:  # what fails before anybody moved a slider is an error of the cell
            self._show(experiment, experiment.run())

    def set(self, **values: Any) -> None:
        """Move several controls at once; the figure is drawn once. Raises ParameterError and moves nothing if a value is not allowed."""
        type(self.experiment)(**{**self.experiment.model_dump(), **values})
        self._held = True
        try:
            for name, value in values.items():
                self.controls[name].value = value
        finally:
            self._held = False
        self._update()

    def _changed(self, _: Any) -> None:
        if not self._held:
            self._update()

    def _update(self) -> None:
        """Run what the controls say and show it. Whatever goes wrong is shown beside the controls, never swallowed."""
        with self._reporting():
            self.experiment = type(self.experiment)(**{p.name: self._value(p) for p in self.experiment.parameters()})
            self._run_id += 1
            if self.experiment.slow:
                threading.Thread(target=self._run_beside, args=(self.experiment, self._run_id), daemon=True).start()
            else:
                self._show(self.experiment, self.experiment.run())

    def _value(self, p: Parameter) -> Any:
        """What a control says; a float slider adds its step up and arrives at 5.000000000000001."""
        value = self.controls[p.name].value
        return round(round(value / p.step) * p.step, 9) if p.type is float and p.step else value

    def _run_beside(self, experiment: Experiment, run_id: int) -> None:
        def listener(fraction: float) -> None:
            if run_id != self._run_id:
                raise Superseded
            self._progress.value = fraction

        progress_listener.set(listener)
        self._progress.layout.visibility = "visible"
        try:
            with self._reporting(lambda: run_id == self._run_id):
                result = experiment.run()
                with self._lock:  # two runs may end together; only the newest is drawn
                    if run_id == self._run_id:
                        self._show(experiment, result)
        except Superseded:
            return
        if run_id == self._run_id:
            self._progress.layout.visibility = "hidden"

    @contextmanager
    def _reporting(self, awaited: Callable[[], bool] = lambda: True) -> Iterator[None]:
        """Show what goes wrong inside, unless nobody waits for it any more."""
        try:
            yield
        except Superseded:
            raise
        except Exception as error:  # the boundary to the person at the slider: shown, with its place
            if not awaited():
                return
            text = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            where = (
                ""
                if isinstance(error, ParameterError)
                else (f"<details><summary>where</summary><pre>{html.escape(traceback.format_exc())}</pre></details>")
            )
            self._error.value = f'<div class="lab-error" role="alert">{html.escape(text)}{where}</div>'

    def _show(self, experiment: Experiment, result: Any) -> None:
        self._draw(self._scaled(experiment.figure(result)))
        self.result = result
        self._metrics.value = metrics_html(experiment.metrics(result))
        self._code.value = (
            f'<code class="lab-code" title="copy this line to make the same bench again">{html.escape(experiment.code())}</code>'
        )
        if self._error.value:
            self._error.value = ""

    def _scaled(self, spec: dict[str, Any]) -> dict[str, Any]:
        scale = LECTURE_SCALE if self._lecture else 1.0
        layout = dict(spec["layout"])
        layout["font"] = {**layout.get("font", {}), "size": round(FONT * scale)}
        layout["annotations"] = [
            {**note, "font": {**note["font"], "size": round(note["font"]["size"] * scale)}} if "font" in note else note
            for note in layout.get("annotations", ())
        ]
        layout["autosize"] = True
        layout["height"] = round(layout.get("height", 460) * (1.2 if self._lecture else 1))
        return {"data": spec["data"], "layout": layout}

    def _draw(self, spec: dict[str, Any]) -> None:
        """Put a figure dict into the FigureWidget: only what differs from the one shown, in one batch."""
        old, self._shown = self._shown, spec
        if old is None:
            self._make_figure()
            return
        with self.figure.batch_update():
            if [t["type"] for t in old["data"]] != [t["type"] for t in spec["data"]]:
                self.figure.data = ()
                self.figure.add_traces(spec["data"])
            else:
                for trace, before, after in zip(self.figure.data, old["data"], spec["data"], strict=True):
                    trace.update(dict(changes(before, after)), overwrite=True)
            self.figure.update_layout(dict(changes(old["layout"], spec["layout"])), overwrite=True)

    def _make_figure(self) -> None:
        """A new FigureWidget with the content shown: the first one, or after the page lost the content of the last."""
        self.figure = Figure(self._shown)
        for number, trace in enumerate(self._shown["data"]):
            if "set" in (trace.get("meta") or {}):
                self.figure.data[number].on_click(lambda _, points, __, number=number: self._clicked(number, points.point_inds))
        self.children = [
            *(c for c in self.children if not isinstance(c, Figure) and c is not self._code),
            self.figure,
            self._code,
        ]

    def _clicked(self, trace: int, points: Sequence[int]) -> None:
        if points:
            with self._reporting():
                self.set(**self._shown["data"][trace]["meta"]["set"][points[0]])

    def _enlarge(self, lecture: bool) -> None:
        self._lecture = lecture
        (self.add_class if lecture else self.remove_class)("lab-lecture")
        if self.result is not None:
            with self._reporting():
                self._draw(self._scaled(self.experiment.figure(self.result)))


def explore(experiment: type[Experiment] | Experiment, **values: Any) -> Bench:
    """A bench for an experiment: a control for each parameter, the figure kept up to date, metrics, reset, the parameters as code.

    `values` are the positions the bench starts (and resets) to. Raises ParameterError for a name or value that is not allowed.
    """
    if isinstance(experiment, Experiment):
        return Bench(type(experiment)(**{**experiment.model_dump(), **values}))
    return Bench(experiment(**values))


def predict(question: str, experiment: Experiment, metric: str, choices: Sequence[str] = ()) -> w.Widget:
    """Ask for a guess before the model answers; the answer is that metric of that experiment, computed when asked for.

    With `choices` the guess is one of these texts, without it a number in the metric's unit.
    """
    found = {m.name: m for m in experiment.metrics(experiment.run())}
    if metric not in found:
        raise ParameterError(f"{experiment.name()} has no metric {metric!r}; it has {', '.join(found)}")
    m = found[metric]
    guess: w.Widget = (
        w.RadioButtons(options=list(choices), value=None, layout=w.Layout(width="auto"))
        if choices
        else w.Text(placeholder="your guess", layout=w.Layout(width="120px"))
    )
    reveal = w.Button(
        description="I have decided", button_style="primary", layout=w.Layout(width="auto", margin="2px 2px 2px 18px")
    )
    reveal.add_class("lab-predict-reveal")
    answer = w.HTML()

    def show(_: Any) -> None:
        try:
            mine = guess.value if choices else float(guess.value) if guess.value else None
        except ValueError:
            answer.value = '<div class="lab-error">Write a number, with a point for the decimals.</div>'
            return
        said = "" if mine is None else f"You said <b>{html.escape(str(mine) if choices else f'{mine:g} {m.unit}')}</b>. "
        right = mine is not None and (mine == m.value if choices else abs(mine - m.value) <= 0.05 * max(1e-12, abs(m.value)))
        answer.value = (
            f'<div style="border-left:6px solid {"#009E73" if right else "#0072B2"};padding:4px 12px;font-size:16px">'
            f"{said}The model says <b>{html.escape(m.text())}</b>. {html.escape(m.note)}</div>"
        )

    reveal.on_click(show)
    unit = [w.HTML(html.escape(m.unit))] if m.unit and not choices else []
    box = w.VBox(
        [
            w.HTML(f'<div style="font-size:17px"><b>Predict.</b> {html.escape(question)}</div>'),
            w.HBox([guess, *unit, reveal], layout=w.Layout(align_items="center")),
            answer,
        ]
    )
    box.add_class("lab-predict")
    return box
