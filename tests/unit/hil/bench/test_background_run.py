"""A run in the background that does not start."""

import pytest

from hil.bench.background_run import BackgroundRun
from hil.errors import HilError


def test_failed_start_reports_the_last_output(tmp_path):
    with pytest.raises(HilError, match=r"did not start: rambler-hil: .*LOOP_RATE_HZ"):
        BackgroundRun(tmp_path / "sea", rate_hz=1000)
