"""Which parameters hold while she saves power."""

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault
from firmware_py.safety.power_saving import BatteryLimits, Saving, parameters_in_force, saving

LOW, CRITICAL = 1 << Fault.BATTERY_LOW, 1 << Fault.BATTERY_CRITICAL


@pytest.mark.parametrize(
    ("active", "how"),
    [
        (0, Saving.NOTHING),
        (1 << Fault.SUPPLY_LOW, Saving.NOTHING),
        (LOW, Saving.SAVES),
        (CRITICAL, Saving.KEEPS_HEADING),
        (LOW | CRITICAL | 1, Saving.KEEPS_HEADING),
    ],
)
def test_how_far_she_saves(active, how):
    assert saving(active) is how


def changed(before, how):
    after = parameters_in_force(before, how)
    return {name: value for name, value in after.items() if before[name] != value}


def test_with_a_full_battery_what_was_set_holds():
    values = ParameterSet()
    assert parameters_in_force(values, Saving.NOTHING) == values


@pytest.mark.parametrize("how", [Saving.SAVES, Saving.KEEPS_HEADING])
def test_she_saves_on_the_rudder_and_on_the_loop_and_on_nothing_else(how):
    values = ParameterSet().replaced("CTL_PRICE", 1.5)
    assert changed(values, how) == {"CTL_PRICE": 4.5, "LOOP_RATE_HZ": 5.0}


def test_a_loop_that_is_slower_already_stays_and_no_parameter_leaves_its_range():
    values = ParameterSet().replaced("CTL_PRICE", 8.0).replaced("LOOP_RATE_HZ", 2)
    assert changed(values, Saving.SAVES) == {"CTL_PRICE": 10.0}
    assert changed(ParameterSet().replaced("PWR_PRICE", 1.0).replaced("PWR_LOOP_HZ", 50), Saving.SAVES) == {}


def test_limits_are_shares_of_the_charge():
    values = ParameterSet().replaced("PWR_SAVE_PCT", 30.0).replaced("PWR_KEEP_VOLT", 12.0)
    assert BatteryLimits.of(values) == BatteryLimits(pytest.approx(0.3), 0.0, 0.0, 12.0)
