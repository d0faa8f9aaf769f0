"""What a slider says its value is."""

import re
from pathlib import Path

import pytest

from labkit import FrameLab, TickRates, TimingModel, explore
from labkit.bench import plot
from labkit.bench.controls import control
from labkit.experiments import experiments

SHEETS = [path for path in Path(plot.__file__).parent.iterdir() if path.suffix in (".css", ".js")]


@pytest.mark.parametrize("experiment, name, digits", [(FrameLab, "z", 2), (TickRates, "start", 2)])
def test_a_slider_shows_every_decimal_of_its_step(experiment, name, digits):
    [parameter] = [p for p in experiment.parameters() if p.name == name]
    assert control(parameter, parameter.default).readout_format == f".{digits}f"


@pytest.mark.parametrize("cls", experiments().values(), ids=experiments().keys())
def test_no_control_has_a_class_that_means_something_else(cls):
    """A parameter `lost` would hide its bench: `.lab-lost` is the notice of a bench whose kernel is gone."""
    taken = set(re.findall(r"\blab-[a-z-]+", "".join(sheet.read_text(encoding="utf-8") for sheet in SHEETS)))
    assert not taken & {name for p in cls.parameters() for name in control(p, p.default)._dom_classes}


def test_a_group_of_controls_has_a_heading_above_it():
    bench = explore(TimingModel)
    box, names = bench.children[0].children, {id(each): name for name, each in bench.controls.items()}
    assert [names.get(id(each)) or each.value.upper() for each in box] == [
        *("THE PROGRAM", "coldness", "passes", "insensitive"),
        *("THE BOARD", "clock", "per_instruction", "overhead", "uncached_data", "data_fill"),
    ]
