"""The widget of each parameter, and what it says."""

from __future__ import annotations

from typing import Any

import ipywidgets as w
import numpy as np

from labkit.experiment import Parameter


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
    elif p.type is str:
        common["layout"] = w.Layout(width="auto", grid_column="1 / -1")
        made = w.Text(continuous_update=False, **common)
    else:
        assert p.low is not None and p.high is not None, "a number has bounds"
        if p.type is int:
            made = w.IntSlider(min=int(p.low), max=int(p.high), step=int(p.step or 1), **common)
        else:
            step = p.step or (p.high - p.low) / 100
            made = w.FloatSlider(min=p.low, max=p.high, step=step, readout_format=f".{_digits(p, step)}f", **common)
    made.add_class(f"lab-{p.name.replace('_', '-')}")
    return made


def heading(text: str) -> w.Widget:
    """What stands above the controls of a group, across all columns (plot.css)."""
    made = w.Label(text)
    made.add_class("lab-group")
    return made


def _digits(p: Parameter, step: float) -> int:
    """Decimals that tell a value from the next: all that the declared step has, 2 for 0.25, else as many as the step is small."""
    if p.step:
        return len(f"{step:.9f}".rstrip("0").partition(".")[2])
    return max(0, -int(np.floor(np.log10(step) + 1e-9))) if step < 1 else 0


def on_grid(p: Parameter, value: Any) -> Any:
    """The value on the parameter's grid; a float slider adds its step up and arrives at 5.000000000000001."""
    return round(round(value / p.step) * p.step, 9) if p.type is float and p.step else value
