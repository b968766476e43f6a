"""Battery reports of another component of the boat."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, ReportBattery, Request, Verdict
from firmware_py.common.parameters import ParameterSet
from firmware_py.core.accept import accept
from firmware_py.core.state import State
from firmware_py.link.services import battery_report
from firmware_py.safety.power_monitor import read_supply

NO_CELL = 65535  # voltage of a cell that does not exist


def battery(number=0, cells=(13_100,), current=-150, percent=87, temperature=1234, more=(0, 0, 0, 0)):
    """BATTERY_STATUS: cells [mV], `more` from the 11th on; current [cA], discharge positive; temperature [cdegC]."""
    voltages = (*cells, *(NO_CELL,) * (10 - len(cells)))
    return mavlink.MAVLink_battery_status_message(
        number, 0, 0, temperature, voltages, current, -1, -1, percent, 0, 0, more, 0, 0
    )


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (battery(), ReportBattery(13.1, 1.5, 0.87, 12.34)),
        (battery(cells=(3300, 3310, 3290, 3300)), ReportBattery(13.2, 1.5, 0.87, 12.34)),
        (battery(cells=(3300,) * 10, more=(3300, 0, 0, 0)), ReportBattery(36.3, 1.5, 0.87, 12.34)),
        (battery(cells=(), current=-1, percent=-1, temperature=32767), ReportBattery()),
        (battery(current=420), ReportBattery(13.1, -4.2, 0.87, 12.34)),
    ],
)
def test_battery_status_is_converted_to_a_report(message, expected):
    report = battery_report(message)
    for name in ReportBattery.__slots__:
        assert getattr(report, name) == (
            None if getattr(expected, name) is None else pytest.approx(getattr(expected, name))
        )


@pytest.fixture
def companion(rig):
    """Send the battery report of a component; return the requests that it causes."""

    def send(message, system=1, component=200, chosen=200):
        rig.request_handler.values = rig.request_handler.values.replaced("PWR_COMPANION", chosen)
        rig.station.srcSystem, rig.station.srcComponent = system, component
        before = len(rig.request_handler.intents)
        rig.send(message)
        return rig.request_handler.intents[before:]

    return send


def test_battery_of_the_selected_component_is_used(companion):
    assert companion(battery()) == [battery_report(battery())]


@pytest.mark.parametrize("sender", [{"chosen": 0}, {"chosen": 201}, {"system": 2}, {"component": 0, "chosen": 0}])
def test_batteries_of_other_components_are_ignored(companion, sender):
    assert companion(battery(), **sender) == []


def test_only_the_first_battery_is_used_at_a_limited_rate(rig, companion):
    assert companion(battery(number=1)) == []
    for seconds, count in ((0.0, 1), (0.0, 0), (0.49, 0), (0.01, 1)):
        rig.now_s += seconds
        assert len(companion(battery())) == count


@pytest.mark.parametrize(("reason", "text"), [("not now", "not now"), ("", "BATTERY_STATUS refused")])
def test_refused_battery_is_reported_with_its_reason(rig, texts, reason, text):
    rig.request_handler.values = rig.request_handler.values.replaced("PWR_COMPANION", 200)
    rig.station.srcSystem, rig.station.srcComponent = 1, 200
    rig.request_handler.answer = Answer(Verdict.DENIED, reason)
    assert texts(rig.send(battery())) == [text]


def decide(**values):
    request = Request(5.0, ReportBattery(**values), 1, 200)
    return accept(State.at_start(ParameterSet()), request)


def test_report_is_used_as_a_measurement():
    state, answer = decide(voltage_v=13.1, current_a=-0.4, charge=0.87)
    assert answer.verdict is Verdict.ACCEPTED
    assert read_supply(state.power, 6.0).charge == 0.87


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("voltage_v", 0.0, 1e3), ("current_a", -5e3, 5e3), ("charge", 0.0, 1.0), ("temperature_c", -60.0, 150.0)],
)
def test_battery_report_out_of_range_is_refused(name, low, high):
    assert {decide(**{name: value})[1].verdict for value in (low, high)} == {Verdict.ACCEPTED}
    for value in (low - 1e-3, high + 1e-3, math.nan, -math.inf):
        state, answer = decide(**{"voltage_v": 13.0} | {name: value})
        assert (answer.verdict, answer.text) == (Verdict.DENIED, "Battery report refused: value out of range")
        assert state.power.samples == (None, None, None)
