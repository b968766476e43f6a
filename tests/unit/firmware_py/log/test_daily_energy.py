import pytest

from firmware_py.log.daily_energy import Day, Sum, read_rows
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


@pytest.mark.parametrize(("measured_s", "estimated", "wh"), [(995.0, False, 9.95 / 3.6), (994.0, True, 10.0 / 3.6)])
def test_energy_is_extrapolated_below_995_of_1000_seconds(measured_s, estimated, wh):
    day = Day("2026-01-01", logged_s=1000.0, load=Sum(10.0 * measured_s, measured_s))
    amount = day.amount(day.load)
    assert (amount.estimated, amount.wh) == (estimated, pytest.approx(wh))
    assert amount.measured_h == pytest.approx(measured_s / 3600.0)
