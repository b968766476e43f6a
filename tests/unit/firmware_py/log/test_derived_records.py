"""Which derived records a tick has, and their values."""

import pytest
from msgspec.structs import replace

from firmware_py.common.reports import DeadReckoningPosition, MissionReport, Wind
from firmware_py.log import derived_records
from firmware_py.log.dataflash import Format
from support.full_log import ESTIMATE, snapshot_of

FORMATS = {
    kind.number: Format(kind.number, kind.size, kind.name, kind.values, kind.labels) for kind in derived_records.TYPES
}
SNAPSHOT = replace(
    snapshot_of(200),
    wind=Wind(1.0, 5.0, 0.1, -3.0, -4.0, 5.5, 0.6, 6.0, 0.7, 1.5, 9.0),
    wind_ok=True,
    dead_reckoning=DeadReckoningPosition(0.7, -0.2, 0.3, 0.4, 50.0, 60.0),
    rudder_estimate_rad=0.15,
    mission=MissionReport(index=3),
)


def messages_of(**changes):
    data, messages = derived_records.encode_snapshot(replace(SNAPSHOT, **changes)), {}
    while data:
        layout = FORMATS[data[2]]
        messages[layout.name] = layout.unpack(data, 0)
        data = data[layout.length :]
    return messages


def test_values_of_a_tick():
    estimate = replace(ESTIMATE, bias_rad=0.2, wave_period_s=7.0, speed_m_s=0.45, prediction_square=1.1)
    messages = messages_of(estimate=estimate)
    time_us = 120_000_000
    assert messages["NAV"] == (time_us, 1.0, 1, 0.01, 0.1, -0.2, 2.0, 1.0, 1.2, 40.0, 1, SNAPSHOT.gain_reduction)
    assert messages["GDN"] == pytest.approx((time_us, 2, 0.7, -0.2, 20.0, 1.5, 0, float("nan"), 1, 3.0), nan_ok=True)
    assert messages["EST"] == (time_us, 1.02, 0.1, 0.1, 0, 0.2, 0.1, 7.0, 0.1, 0.45, 0.1, 0.1, 0.1, 0.1, 1.2, 1.1)
    assert messages["WTR"] == (time_us, 0.4, 0.1, 0.2, -0.1, 0.1, 0.0, 0.0, 0)
    assert messages["SUPL"] == pytest.approx((time_us, 12.9, -0.5, 0.8, *[float("nan")] * 2, *[0.0] * 4), nan_ok=True)
    assert messages["ENRG"] == pytest.approx((time_us, 0.0, 0, 10.0, 0.0, 0.0, 1.0, 0))
    assert messages["WNDG"] == (time_us, 5.5, 0.6, 6.0, 0.7, 1.5, 9.0, 5.0, 0.1)
    assert messages["RKN"] == (time_us, 0.7, -0.2, 0.3, 0.4, 50.0, 60.0)
    assert messages["RUDE"] == (time_us, 0.15, 0.25)


@pytest.mark.parametrize(
    ("changes", "missing"),
    [
        ({}, set()),
        ({"tick": 201}, {"GDN", "ENRG", "RKN", "WNDG", "SUPL", "WTR"}),
        ({"tick": 209}, {"GDN", "ENRG", "RKN", "WNDG", "SUPL", "WTR"}),
        ({"tick": 210}, set()),
        ({"estimate": None}, {"EST"}),
        ({"rudder_estimate_rad": None}, {"RUDE"}),
        ({"energy": None}, {"ENRG"}),
        ({"dead_reckoning": None}, {"RKN"}),
        ({"wind": None}, {"WNDG"}),
        ({"wind_ok": False}, {"WNDG"}),
        ({"power": None}, {"SUPL"}),
        ({"water": None}, {"WTR"}),
    ],
)
def test_records_are_logged_every_ten_ticks_and_if_known(changes, missing):
    names = {"NAV", "EST", "RUDE", "GDN", "ENRG", "RKN", "WNDG", "SUPL", "WTR"}
    assert messages_of(**changes).keys() == names - missing
