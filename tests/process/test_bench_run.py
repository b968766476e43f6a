"""The measurements of the autopilot itself, as short as possible; no figure is judged."""

import math
from dataclasses import replace

import pytest

from hil.bench.setting import quick


@pytest.mark.proof
@pytest.mark.parametrize("name", ["sense", "load", "start"])
def test_a_measurement_finds_all_its_figures(name, tmp_path):
    from hil.bench.measurements import TABLE  # noqa: PLC0415 - with numba and scipy: no time of each collection

    setting = replace(
        quick(tmp_path),
        lock_s=1.0,
        sense_s=1.5,
        load_s=1.0,
        bare_load_s=0.3,
        starts=1,
    )
    finding = TABLE[name].measure(setting)
    assert finding.notes
    for figure in finding.figures:
        assert math.isfinite(figure.value), figure
        assert figure.value > 0.0, figure
        assert figure.bare is None or math.isfinite(figure.bare), figure
