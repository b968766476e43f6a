"""The run in the background, when it does not come about."""

import pytest

from hil.bench.sea import Sea
from hil.errors import HilError


def test_a_run_that_does_not_start_is_told_with_its_last_words(tmp_path):
    with pytest.raises(HilError, match=r"did not start: rambler-hil: .*LOOP_RATE_HZ"):
        Sea(tmp_path / "sea", rate_hz=1000)
