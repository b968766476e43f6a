"""The measurements of `rambler-hil bench` on the autopilot, as short as possible and without limits."""

import math
from dataclasses import replace

import pytest

from hil.bench.setting import quick


@pytest.mark.proof
@pytest.mark.parametrize("name", ["sense", "load", "start"])
def test_measurement_gives_all_its_figures(name, tmp_path):
    from hil.bench.measurements import TABLE  # noqa: PLC0415 - numba and scipy would delay each collection

    setting = replace(quick(tmp_path), lock_s=1.0, sense_s=1.5, load_s=1.0, bare_load_s=0.3, starts=1)
    finding = TABLE[name].measure(setting)
    assert finding.notes
    for figure in finding.figures:
        assert math.isfinite(figure.value), figure
        assert figure.value > 0.0, figure
        assert figure.bare is None or math.isfinite(figure.bare), figure
