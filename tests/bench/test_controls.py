"""What a slider says its value is."""

import pytest

from labkit import FrameLab, TickRates
from labkit.bench.controls import control


@pytest.mark.parametrize("experiment, name, digits", [(FrameLab, "z", 2), (TickRates, "start", 2)])
def test_a_slider_shows_every_decimal_of_its_step(experiment, name, digits):
    [parameter] = [p for p in experiment.parameters() if p.name == name]
    assert control(parameter, parameter.default).readout_format == f".{digits}f"
