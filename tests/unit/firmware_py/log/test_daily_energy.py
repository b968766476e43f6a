"""Rows of the thin log are summed by day."""

import pytest

from firmware_py.log.daily_energy import Amount, Day, Row, Sum, list_thin_logs, read_rows, sum_by_day
from firmware_py.log.dataflash import LogError
from firmware_py.log.thin import HEAD, SAILING, UPKEEP, Minute

MIDNIGHT_S = 1_798_761_600.0  # 2027-01-01


def rows_of(path, data):
    path.write_bytes(HEAD + data)
    return list(read_rows([path]))


@pytest.mark.parametrize(
    ("span_s", "is_read"), [(-1.0, False), (0.0, False), (0.5, True), (600.0, True), (601.0, False)]
)
def test_rows_of_an_impossible_duration_are_ignored(tmp_path, span_s, is_read):
    row = Minute(1.8e9, span_s, 0, True, 0)
    data = SAILING.pack(60.0, row) + UPKEEP.pack(60.0, row)
    assert bool(rows_of(tmp_path / "00000001.BIN", data)) is is_read


def test_a_row_is_two_messages_of_the_same_time(tmp_path):
    row = Minute(1.8e9, 60.0, 0, True, 5, battery_v=12.5, load_w=4.0)
    data = UPKEEP.pack(60.0, row) + SAILING.pack(120.0, row) + UPKEEP.pack(180.0, row) + UPKEEP.pack(120.0, row)
    data += SAILING.pack(240.0, row) + UPKEEP.pack(240.0, row)
    (read,) = rows_of(tmp_path / "00000001.BIN", data)
    assert (read.utc_s, read.span_s, read.value("Flt"), read.value("BatV"), read.value("SoC")) == (
        1.8e9,
        60.0,
        5.0,
        12.5,
        None,
    )


def test_clock_of_all_logs_is_corrected_and_an_unreadable_log_is_named(tmp_path):
    (tmp_path / "thin").mkdir()
    rows = [Minute(utc_s, 60.0, 0, True, faults=100) for utc_s in (0.0, MIDNIGHT_S)]
    for number, row in enumerate(rows, start=1):
        data = SAILING.pack(60.0 * number, row) + UPKEEP.pack(60.0 * number, row)
        (tmp_path / f"thin/{number:08d}.BIN").write_bytes(HEAD + data)
    paths = list_thin_logs(tmp_path)
    assert [path.name for path in paths] == ["00000001.BIN", "00000002.BIN"]
    assert [row.utc_s for row in read_rows(paths)] == [MIDNIGHT_S - 60.0, MIDNIGHT_S]
    assert list_thin_logs(tmp_path / "none") == []
    with pytest.raises(LogError, match=r"none\.BIN: No such file or directory: give a thin log"):
        list(read_rows([*paths, tmp_path / "none.BIN"]))


def row(utc_s=0.0, span_s=60.0, **values):
    return Row(utc_s, span_s, values)


def test_powers_are_summed_where_they_are_measured():
    day = Day("x")
    measured = {"BatV": 12.0, "BatA": 0.5, "Enr": 30.0, "VSrv": 11.0, "Sun": 8.0, "Load": 5.0, "SoC": 0.75}
    day.add(row(**measured))
    day.add(row(span_s=30.0, **measured | {"BatA": -0.25}))
    for missing in ("BatV", "BatA", "Enr", "VSrv", "Sun", "Load", "SoC"):
        day.add(row(**{name: value for name, value in measured.items() if name != missing}))
    assert day == Day(
        "x", logged_s=510.0, solar=Sum(3600.0, 450.0), load=Sum(2250.0, 450.0), servo=Sum(210.0, 390.0),
        charged=Sum(6.0 * 360.0, 390.0), discharged=Sum(3.0 * 30.0, 390.0), charge=0.75,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("load", "servo", "rest_w", "expected"),
    [
        (Sum(7200.0, 3600.0), Sum(3600.0, 3600.0), None, ((2.0, 1.0, False), (1.0, 1.0, False), (1.0, 1.0, False))),
        (Sum(3600.0, 1800.0), Sum(3600.0, 3600.0), None, ((2.0, 0.5, True), (1.0, 1.0, False), (1.0, 0.5, True))),
        (Sum(7200.0, 3600.0), Sum(1800.0, 1800.0), None, ((2.0, 1.0, False), (1.0, 0.5, True), (1.0, 0.5, True))),
        (Sum(1.0, 0.5), Sum(), None, ((2.0, 0.5 / 3600.0, True), None, None)),
        (Sum(), Sum(3600.0, 3600.0), 4.0, ((5.0, 0.0, True), (1.0, 1.0, False), (4.0, 0.0, True))),
        (Sum(), Sum(), 4.0, ((4.0, 0.0, True), None, None)),
        (Sum(), Sum(3600.0, 3600.0), None, (None, (1.0, 1.0, False), None)),
        (Sum(7200.0, 3600.0), Sum(), 4.0, ((2.0, 1.0, False), None, None)),
    ],
)
def test_rest_is_the_load_less_the_servo(load, servo, rest_w, expected):
    day = Day("x", logged_s=3600.0, load=load, servo=servo, solar=Sum(3600.0, 3600.0), charged=Sum(1800.0, 3600.0))
    amounts = day.amounts(rest_w)
    names = ("load", "servo", "rest")
    assert tuple(amounts[name] for name in names) == tuple(None if row is None else Amount(*row) for row in expected)
    assert (amounts["solar"].wh, amounts["charged"].wh, amounts["discharged"]) == (1.0, 0.5, None)
    assert Day("y").amounts(rest_w)["load"] is None  # nothing was logged


@pytest.mark.parametrize(("measured_s", "estimated", "wh"), [(995.0, False, 9.95 / 3.6), (994.0, True, 10.0 / 3.6)])
def test_energy_is_extrapolated_below_995_of_1000_seconds(measured_s, estimated, wh):
    day = Day("2026-01-01", logged_s=1000.0, load=Sum(10.0 * measured_s, measured_s))
    assert day.amount(day.load) == Amount(pytest.approx(wh), pytest.approx(measured_s / 3600.0), estimated)


def test_a_row_belongs_to_the_day_of_its_middle():
    times_s = (MIDNIGHT_S + 30.0, MIDNIGHT_S + 29.0, MIDNIGHT_S + 86_400.0 + 29.0, MIDNIGHT_S + 86_400.0 + 30.0, 0.0)
    days = sum_by_day(row(time_s, SoC=number) for number, time_s in enumerate(times_s))
    assert [(day.name, day.logged_s, day.charge) for day in days] == [
        ("", 60.0, 4), ("2026-12-31", 60.0, 1), ("2027-01-01", 120.0, 2), ("2027-01-02", 60.0, 3)
    ]  # fmt: skip
