"""Every measurement of the autopilot once, around the real autopilot, as short as it can be; no figure is judged."""

import math
from dataclasses import replace

import pytest

from hil.bench.measurements import TABLE
from hil.bench.setting import quick


@pytest.mark.parametrize("name", ["lateness", "sense", "load", "start", "trips"])
def test_a_measurement_finds_all_its_figures(name, tmp_path):
    setting = replace(
        quick(tmp_path),
        lateness_s={10: 1.0, 50: 1.0},
        lock_s=1.0,
        sense_s=1.5,
        echoes=4,
        load_s=1.0,
        bare_load_s=0.3,
        starts=1,
        trips=5,
    )
    finding = TABLE[name].measure(setting)
    assert finding.notes
    for figure in finding.figures:
        assert math.isfinite(figure.value), figure
        assert figure.value > 0.0, figure
        assert figure.bare is not None, figure
        assert math.isfinite(figure.bare), figure
