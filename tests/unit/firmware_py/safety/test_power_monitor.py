"""State of battery, panels and loads, from the samples of monitors and chargers."""

import itertools

import numpy as np
import pytest

from firmware_py.common.records import PowerSample
from firmware_py.safety import power_monitor
from firmware_py.safety.power_monitor import PowerMonitorState, read_supply, update
from firmware_py.sensors.vedirect import VeDirectPower
from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.ship.disturbances import Supply as PowerOptions
from hil.ship.power_plant import Place, PowerPlant
from support.line import FakeLine

COMPANION = 2
MAX_AGE_S = 15.0

MIDNIGHT_UTC_S = 1_782_000_000.0 - 1_782_000_000.0 % 86_400.0


def charger(source=0, voltage_v=13.0, current_a=2.0, solar_w=40.0, **options):
    return PowerSample(1.0, source, voltage_v, current_a, solar_w=solar_w, **options)


def monitor(source=1, voltage_v=12.9, current_a=0.5, charge=0.8, **options):
    return PowerSample(1.0, source, voltage_v, current_a, charge, **options)


def test_supply_is_unknown_without_samples():
    assert read_supply(PowerMonitorState(), 1.0) == power_monitor.Supply()
    assert power_monitor.report(PowerMonitorState(), 1.0) is None


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        pytest.param(
            [charger()],
            {"voltage_v": 13.0, "solar_w": 26.0, "current_a": None, "load_w": None, "charge": None, "battery_w": None},
            id="charger alone: no battery current and no load",
        ),
        pytest.param(
            [charger(current_a=-0.1, load_a=0.4, solar_w=4.0)],
            {"current_a": -0.1, "load_w": 5.2, "solar_w": 3.9, "battery_w": -1.3},
            id="charger with load output",
        ),
        pytest.param(
            [monitor(voltage_v=None)], {"voltage_v": None, "current_a": 0.5, "battery_w": None}, id="no voltage"
        ),
        pytest.param([charger(current_a=None)], {"voltage_v": 13.0, "solar_w": 40.0}, id="charger without a current"),
        pytest.param(
            [charger(voltage_v=None, load_a=1.0)],
            {"voltage_v": None, "solar_w": 40.0, "load_w": None, "current_a": None},
            id="charger without a voltage",
        ),
        pytest.param(
            [charger(current_a=-0.01, solar_w=0.0)], {"solar_w": 0.0}, id="charger that draws current at night"
        ),
        pytest.param(
            [monitor(current_a=-0.4, temperature_c=9.0)],
            {
                "voltage_v": 12.9,
                "current_a": -0.4,
                "charge": 0.8,
                "temperature_c": 9.0,
                "solar_w": None,
                "load_w": None,
            },
            id="monitor alone: no panels",
        ),
        pytest.param(
            [charger(), monitor()],
            {"voltage_v": 12.9, "current_a": 0.5, "load_w": 26.0 - 12.9 * 0.5},
            id="both: load is panel output minus battery power",
        ),
        pytest.param([charger(), charger(source=1, current_a=1.0)], {"solar_w": 39.0}, id="sum of two chargers"),
        pytest.param(
            [monitor(charge=None), monitor(source=COMPANION, voltage_v=11.0, current_a=9.0, charge=0.3)],
            {"voltage_v": 12.9, "current_a": 0.5, "charge": 0.3},
            id="own monitor before that of another component",
        ),
    ],
)
def test_supply_combines_monitors_and_chargers(samples, expected):
    supply = read_supply(update(PowerMonitorState(), samples), 1.0)
    for name, value in expected.items():
        assert getattr(supply, name) == (None if value is None else pytest.approx(value)), name


def test_old_samples_are_ignored_and_an_outdated_source_is_detected():
    state = update(PowerMonitorState(), [monitor()])
    assert read_supply(state, 1.0 + MAX_AGE_S).charge == 0.8
    assert not power_monitor.has_outdated_source(state, 1.0 + MAX_AGE_S)
    assert read_supply(state, 1.1 + MAX_AGE_S).charge is None
    assert power_monitor.has_outdated_source(state, 1.1 + MAX_AGE_S)


def test_gap_adds_no_time_and_no_energy():
    times = [0.0, 1.0, 2.0, 2.0 + MAX_AGE_S + 1.0, 3.0 + MAX_AGE_S + 1.0]
    state = update(PowerMonitorState(), [PowerSample(t_s, 1, 10.0, -1.0) for t_s in times])
    assert (state.discharged.energy_j, state.discharged.measured_s) == (pytest.approx(30.0), pytest.approx(3.0))
    assert (state.charged.energy_j, state.load.measured_s) == (0.0, 0.0)


@pytest.mark.parametrize("kinds", [(Kind.CHARGER, Kind.MONITOR), (Kind.CHARGER_WITH_LOAD,)])
@pytest.mark.parametrize("hours", [(18.0, 20.0), pytest.param((0.0, 48.0), marks=pytest.mark.proof)])
def test_energies_of_a_cloudy_evening_are_accurate_to_1_percent(kinds, hours):
    begin_utc_s = MIDNIGHT_UTC_S + 3600.0 * hours[0]
    plant = PowerPlant(
        PowerOptions(clouds=0.5, charge=0.4), Place(36.0, 0.0, begin_utc_s), np.random.default_rng(3), servo_energy()
    )
    devices = [
        (VeDirectEmulator(plant, kind, phase_s=0.3 * source), VeDirectPower(wire), wire, source)
        for source, (kind, wire) in enumerate(zip(kinds, (FakeLine(), FakeLine()), strict=False))
    ]
    state, until_s = PowerMonitorState(), 3600.0 * (hours[1] - hours[0])
    while (now_s := min(emulator.next_output_s() for emulator, *_ in devices)) < until_s:
        for emulator, driver, wire, source in devices:
            if emulator.next_output_s() <= now_s:
                wire.inbox += emulator.take_output(now_s)
                driver.receive(now_s)
                samples = [PowerSample(**{**as_dict(sample), "source": source}) for sample in driver.poll()]
                state = update(state, samples)
    totals = plant.totals
    assert state.solar.energy_j == pytest.approx(totals.charger_j, rel=0.01)
    assert state.load.energy_j == pytest.approx(totals.load_j, rel=0.01)
    assert state.charged.energy_j == pytest.approx(totals.into_battery_j, rel=0.01)
    assert state.discharged.energy_j == pytest.approx(totals.out_of_battery_j, rel=0.01)
    assert totals.out_of_battery_j > 0.0
    assert state.load.measured_s == pytest.approx(until_s, abs=5.0)


def servo_energy():
    """Return a function that gives the energy of a servo [J], with bursts."""
    energies_j = itertools.accumulate(3.0 if number % 7 == 0 else 0.2 for number in itertools.count())
    return lambda: next(energies_j)


def as_dict(sample):
    return {name: getattr(sample, name) for name in PowerSample.__slots__}
