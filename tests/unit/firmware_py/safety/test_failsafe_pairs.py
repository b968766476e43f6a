"""All pairs of faults that change the mode, in both orders: the fault that decides, and the mode after both."""

import itertools

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import PRECEDENCE, TABLE, Fault
from firmware_py.modes import ModeState, Situation
from firmware_py.safety.supervisor import SupervisorSettings, SupervisorState, apply_failsafe

ALL_POSSIBLE = Situation(1.0, None, position_ok=True, rudder_ok=True, mission_ok=True, home_ok=True)
SETTINGS = SupervisorSettings.of(ParameterSet())
# Failsafe modes of the first and the second fault of a pair.
CHOICES = ((Mode.HOLD, Mode.RTL), (Mode.RTL, Mode.HOLD), (Mode.HOLD, Mode.HOLD), (Mode.STEERING, Mode.LOITER))
ORDERED = (Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.MANUAL, Mode.HOLD)
PAIRS = tuple(itertools.permutations(PRECEDENCE, 2))


class Boat:
    """A boat whose failsafes act as in core/step.py."""

    def __init__(self, mode, chosen, *, resume=False):
        self.settings = replace(SETTINGS, failsafe_modes=dict.fromkeys(PRECEDENCE) | chosen, resume=resume)
        self.state, self.modes = SupervisorState(), ModeState(mode, armed=True)
        self.texts = []

    def tick(self, *faults, order=None):
        if order is not None:
            self.modes = replace(self.modes, mode=order, by_failsafe=False)
        active = sum(1 << fault for fault in faults)
        for _ in range(2):  # the second call changes nothing
            self.state, self.modes, events = apply_failsafe(
                self.settings, self.state, self.modes, active, ALL_POSSIBLE, overruled=order is not None
            )
            self.texts += [event.text for event in events]
            order = None
        return self.modes.mode


def may_act(fault, mode):
    """Return whether a fault may act in a mode that the operator has ordered."""
    return mode is not Mode.HOLD and (mode is not Mode.MANUAL or TABLE[fault].acts_in_manual)


def expected_mode(ordered, chosen, sequence):
    """Return the mode after a sequence of sets of active faults since an order; the last set is not empty.

    In a mode that a failsafe has chosen, every fault acts.
    """
    mode, has_acted = ordered, False
    for faults in sequence:
        has_acted = has_acted or any(may_act(fault, ordered) for fault in faults)
        mode = chosen[min(faults, key=PRECEDENCE.index)] if has_acted else ordered
    return mode


def mode_left_by(fault, chosen, interrupted):
    """Return the mode after the end of a failsafe without FS_RESUME."""
    return interrupted if TABLE[fault].always_resumes else chosen[fault]


def test_precedence_is_by_severity_and_contains_each_fault_with_a_parameter():
    assert set(PRECEDENCE) == {fault for fault, row in TABLE.items() if row.parameter}
    severities = [TABLE[fault].severity for fault in PRECEDENCE]
    assert severities == sorted(severities)


@pytest.mark.parametrize("ordered", ORDERED)
@pytest.mark.parametrize("resume", [False, True])
def test_first_fault_in_precedence_decides_in_either_order(ordered, resume):
    for ((first, second), modes), last in itertools.product(itertools.product(PAIRS, CHOICES), (0, 1)):
        chosen = dict(zip((first, second), modes, strict=True))
        boat, sequence = Boat(ordered, chosen, resume=resume), []
        for faults in ((first,), (first, second), ((first, second)[last],)):
            sequence.append(faults)
            assert boat.tick(*faults) is expected_mode(ordered, chosen, sequence), sequence


@pytest.mark.parametrize("ordered", [Mode.AUTO, Mode.GUIDED, Mode.LOITER])
def test_ordered_mode_resumes_after_each_pair(ordered):
    for (first, second), modes in itertools.product(PAIRS, CHOICES):
        chosen = dict(zip((first, second), modes, strict=True))
        for cleared in (first, second):
            boat = Boat(ordered, chosen, resume=True)
            boat.tick(first)
            boat.tick(first, second)
            boat.tick(first if cleared is second else second)
            assert boat.tick() is ordered, (first, second, cleared)
            assert not boat.modes.by_failsafe


@pytest.mark.parametrize("ordered", [Mode.AUTO, Mode.GUIDED])
def test_mode_of_the_last_decision_stays_after_a_pair_without_fs_resume(ordered):
    for (first, second), modes in itertools.product(PAIRS, CHOICES):
        chosen = dict(zip((first, second), modes, strict=True))
        boat = Boat(ordered, chosen)
        boat.tick(first)
        boat.tick(first, second)
        boat.tick(second)
        after_first = mode_left_by(first, chosen, ordered)
        assert boat.tick() is mode_left_by(second, chosen, after_first), (first, second)
        assert boat.modes.by_failsafe is (boat.modes.mode is not ordered)


def test_each_later_fault_acts_in_the_mode_of_a_failsafe():
    """For example a low supply in the HOLD that stays after an earlier servo fault."""
    for (first, second), mode in itertools.product(PAIRS, (Mode.RTL, Mode.STEERING, Mode.HOLD)):
        boat = Boat(Mode.AUTO, {first: Mode.HOLD, second: mode})
        boat.tick(first)
        boat.tick()
        assert boat.tick(second) is mode, (first, second)


@pytest.mark.parametrize("order", ORDERED)
def test_order_overrules_active_faults_but_not_later_ones(order):
    for first, second in PAIRS:
        chosen = {first: Mode.HOLD, second: Mode.RTL}
        boat = Boat(Mode.AUTO, chosen, resume=True)
        boat.tick(first, second)
        assert boat.tick(first, second, order=order) is order
        assert boat.tick(second) is order
        mode = chosen[first] if may_act(first, order) else order
        assert boat.tick(first, second) is mode, (first, second)
        # MANUAL does not resume.
        assert boat.tick() is (mode if order is Mode.MANUAL else order)


def test_only_loss_of_the_ground_station_acts_in_manual():
    for fault in PRECEDENCE:
        if TABLE[fault].acts_in_manual:
            continue
        lost = Fault.STATION_SILENT
        boat = Boat(Mode.MANUAL, {lost: Mode.LOITER, fault: Mode.RTL})
        assert boat.tick(fault) is Mode.MANUAL
        first = min((fault, lost), key=PRECEDENCE.index)
        assert boat.tick(fault, lost) is (Mode.RTL if first is fault else Mode.LOITER)
        # A fault that is active when MANUAL is ordered does not act.
        boat = Boat(Mode.AUTO, {lost: Mode.LOITER, fault: Mode.RTL})
        boat.tick(fault)
        boat.tick(fault, order=Mode.MANUAL)
        assert boat.tick(fault, lost) is Mode.LOITER


def test_each_decision_and_the_end_of_a_failsafe_are_reported():
    hot, low = Fault.RUDDER_HOT, Fault.SUPPLY_LOW
    boat = Boat(Mode.AUTO, {hot: Mode.HOLD, low: Mode.RTL})
    for faults in ((hot,), (hot, low), (hot,), (), (low,), ()):
        boat.tick(*faults)
    assert boat.texts == [
        "Failsafe: HOLD",
        "Failsafe: RTL",
        "Failsafe: HOLD",
        "Failsafe ended: HOLD stays until a mode is set",
        "Failsafe: RTL",
        "Failsafe ended: RTL stays until a mode is set",
    ]
