"""Parameters in force at each level of power saving."""

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault
from firmware_py.safety.power_saving import BatteryLimits, PowerSaving, level_of, parameters_in_force

LOW, CRITICAL = 1 << Fault.BATTERY_LOW, 1 << Fault.BATTERY_CRITICAL


@pytest.mark.parametrize(
    ("active", "level"),
    [
        (0, PowerSaving.OFF),
        (1 << Fault.SUPPLY_LOW, PowerSaving.OFF),
        (LOW, PowerSaving.SAVING),
        (CRITICAL, PowerSaving.HEADING_ONLY),
        (LOW | CRITICAL | 1, PowerSaving.HEADING_ONLY),
    ],
)
def test_level_of_power_saving(active, level):
    assert level_of(active) is level


def replaced_parameters(values, level):
    in_force = parameters_in_force(values, level)
    return {name: value for name, value in in_force.items() if values[name] != value}


def test_no_parameter_is_replaced_with_a_full_battery():
    values = ParameterSet()
    assert parameters_in_force(values, PowerSaving.OFF) == values


@pytest.mark.parametrize("level", [PowerSaving.SAVING, PowerSaving.HEADING_ONLY])
def test_power_saving_replaces_only_price_and_loop_rate(level):
    values = ParameterSet().replaced("CTL_PRICE", 1.5)
    assert replaced_parameters(values, level) == {"CTL_PRICE": 4.5, "LOOP_RATE_HZ": 5.0}


def test_slower_loop_stays_and_parameters_stay_in_range():
    values = ParameterSet().replaced("CTL_PRICE", 8.0).replaced("LOOP_RATE_HZ", 2)
    assert replaced_parameters(values, PowerSaving.SAVING) == {"CTL_PRICE": 10.0}
    assert (
        replaced_parameters(ParameterSet().replaced("PWR_PRICE", 1.0).replaced("PWR_LOOP_HZ", 50), PowerSaving.SAVING)
        == {}
    )


def test_limits_are_shares_of_the_charge():
    values = ParameterSet().replaced("PWR_SAVE_PCT", 30.0).replaced("PWR_KEEP_VOLT", 12.0)
    assert BatteryLimits.of(values) == BatteryLimits(pytest.approx(0.3), 0.0, 0.0, 12.0)
