"""The run in the background, when it does not come about."""

import pytest

from hil.bench.sea import Sea
from hil.errors import HilError


def test_a_failed_start_reports_the_last_output(tmp_path):
    with pytest.raises(HilError, match=r"did not start: rambler-hil: .*LOOP_RATE_HZ"):
        Sea(tmp_path / "sea", rate_hz=1000)
