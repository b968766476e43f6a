"""Parameters in force at each level of power saving."""

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault
from firmware_py.safety.power_saving import BatteryLimits, PowerSaving, level_of, parameters_in_force

LOW, CRITICAL = 1 << Fault.BATTERY_LOW, 1 << Fault.BATTERY_CRITICAL


@pytest.mark.parametrize(
    ("active", "how"),
    [
        (0, PowerSaving.OFF),
        (1 << Fault.SUPPLY_LOW, PowerSaving.OFF),
        (LOW, PowerSaving.SAVING),
        (CRITICAL, PowerSaving.HEADING_ONLY),
        (LOW | CRITICAL | 1, PowerSaving.HEADING_ONLY),
    ],
)
def test_the_level_of_power_saving(active, how):
    assert level_of(active) is how


def changed(before, how):
    after = parameters_in_force(before, how)
    return {name: value for name, value in after.items() if before[name] != value}


def test_with_a_full_battery_no_parameter_is_replaced():
    values = ParameterSet()
    assert parameters_in_force(values, PowerSaving.OFF) == values


@pytest.mark.parametrize("how", [PowerSaving.SAVING, PowerSaving.HEADING_ONLY])
def test_power_saving_replaces_price_and_loop_rate_alone(how):
    values = ParameterSet().replaced("CTL_PRICE", 1.5)
    assert changed(values, how) == {"CTL_PRICE": 4.5, "LOOP_RATE_HZ": 5.0}


def test_a_slower_loop_is_kept_and_no_parameter_leaves_its_range():
    values = ParameterSet().replaced("CTL_PRICE", 8.0).replaced("LOOP_RATE_HZ", 2)
    assert changed(values, PowerSaving.SAVING) == {"CTL_PRICE": 10.0}
    assert changed(ParameterSet().replaced("PWR_PRICE", 1.0).replaced("PWR_LOOP_HZ", 50), PowerSaving.SAVING) == {}


def test_limits_are_shares_of_the_charge():
    values = ParameterSet().replaced("PWR_SAVE_PCT", 30.0).replaced("PWR_KEEP_VOLT", 12.0)
    assert BatteryLimits.of(values) == BatteryLimits(pytest.approx(0.3), 0.0, 0.0, 12.0)
