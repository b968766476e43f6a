import pytest

from firmware_py.log.daily_energy import Sum, read_rows
from firmware_py.log.thin import HEAD, SAILING, UPKEEP, Minute

MAX_ROW_S = 600.0


@pytest.mark.parametrize(
    ("span_s", "is_read"), [(-1.0, False), (0.0, False), (0.5, True), (MAX_ROW_S, True), (MAX_ROW_S + 1.0, False)]
)
def test_rows_of_an_impossible_duration_are_ignored(tmp_path, span_s, is_read):
    row = Minute(1.8e9, span_s, 0, True, 0)
    (tmp_path / "00000001.BIN").write_bytes(HEAD + SAILING.pack(60.0, row) + UPKEEP.pack(60.0, row))
    assert bool(list(read_rows([tmp_path / "00000001.BIN"]))) is is_read


def test_energy_of_measured_intervals_is_summed():
    total = Sum()
    for power_w in (3.0, None, 5.0):
        total.add(power_w, 60.0)
    assert total == Sum(480.0, 120.0)
