"""All pairs of faults that change the mode, in both orders: which one decides, and the mode afterwards."""

import itertools

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import PRECEDENCE, TABLE, Fault
from firmware_py.modes import ModeState, Situation
from firmware_py.safety.supervisor import SupervisorSettings, SupervisorState, apply_failsafe

EVERYTHING = Situation(1.0, None, position_ok=True, rudder_ok=True, mission_ok=True, home_ok=True)
SETTINGS = SupervisorSettings.of(ParameterSet())
# Modes of the first and the second of a pair.
CHOICES = ((Mode.HOLD, Mode.RTL), (Mode.RTL, Mode.HOLD), (Mode.HOLD, Mode.HOLD), (Mode.STEERING, Mode.LOITER))
ORDERED = (Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.MANUAL, Mode.HOLD)
PAIRS = tuple(itertools.permutations(PRECEDENCE, 2))


class Boat:
    """A boat whose failsafes act as in step()."""

    def __init__(self, mode, chosen, *, resume=False):
        self.settings = replace(SETTINGS, failsafe_modes=dict.fromkeys(PRECEDENCE) | chosen, resume=resume)
        self.state, self.modes = SupervisorState(), ModeState(mode, armed=True)
        self.texts = []

    def tick(self, *faults, order=None):
        if order is not None:
            self.modes = replace(self.modes, mode=order, by_failsafe=False)
        active = sum(1 << fault for fault in faults)
        for _ in range(2):  # the second changes nothing
            self.state, self.modes, events = apply_failsafe(
                self.settings, self.state, self.modes, active, EVERYTHING, overruled=order is not None
            )
            self.texts += [event.text for event in events]
            order = None
        return self.modes.mode


def acts(fault, mode):
    """Return whether a fault may act in a mode that the operator has ordered."""
    return mode is not Mode.HOLD and (mode is not Mode.MANUAL or TABLE[fault].acts_in_manual)


def expected_mode(ordered, chosen, stood):
    """Return the last mode after a sequence of sets of faults since an order; the last set is not empty.

    In a mode that a failsafe chose, every fault acts.
    """
    mode, taken = ordered, False
    for faults in stood:
        taken = taken or any(acts(fault, ordered) for fault in faults)
        mode = chosen[min(faults, key=PRECEDENCE.index)] if taken else ordered
    return mode


def left_by(fault, chosen, before):
    """Return the mode after a failsafe that has ended without FS_RESUME."""
    return before if TABLE[fault].always_resumes else chosen[fault]


def test_precedence_is_by_severity_and_has_every_fault_with_a_parameter():
    assert set(PRECEDENCE) == {fault for fault, row in TABLE.items() if row.parameter}
    severities = [TABLE[fault].severity for fault in PRECEDENCE]
    assert severities == sorted(severities)


@pytest.mark.parametrize("ordered", ORDERED)
@pytest.mark.parametrize("resume", [False, True])
def test_of_every_pair_the_first_in_precedence_decides_whichever_came_first(ordered, resume):
    for ((first, second), modes), last in itertools.product(itertools.product(PAIRS, CHOICES), (0, 1)):
        chosen = dict(zip((first, second), modes, strict=True))
        boat, stood = Boat(ordered, chosen, resume=resume), []
        for faults in ((first,), (first, second), ((first, second)[last],)):
            stood.append(faults)
            assert boat.tick(*faults) is expected_mode(ordered, chosen, stood), stood


@pytest.mark.parametrize("ordered", [Mode.AUTO, Mode.GUIDED, Mode.LOITER])
def test_after_every_pair_the_ordered_mode_resumes(ordered):
    for (first, second), modes in itertools.product(PAIRS, CHOICES):
        chosen = dict(zip((first, second), modes, strict=True))
        for gone in (first, second):
            boat = Boat(ordered, chosen, resume=True)
            boat.tick(first)
            boat.tick(first, second)
            boat.tick(first if gone is second else second)
            assert boat.tick() is ordered, (first, second, gone)
            assert not boat.modes.by_failsafe


@pytest.mark.parametrize("ordered", [Mode.AUTO, Mode.GUIDED])
def test_after_a_pair_the_mode_of_the_last_decision_is_kept(ordered):
    for (first, second), modes in itertools.product(PAIRS, CHOICES):
        chosen = dict(zip((first, second), modes, strict=True))
        boat = Boat(ordered, chosen)
        boat.tick(first)
        boat.tick(first, second)
        boat.tick(second)
        over_first = left_by(first, chosen, ordered)
        assert boat.tick() is left_by(second, chosen, over_first), (first, second)
        assert boat.modes.by_failsafe is (boat.modes.mode is not ordered)


def test_in_the_mode_of_a_failsafe_every_later_fault_acts():
    """A low supply acts in a HOLD that an earlier fault of the servo has left."""
    for (first, second), mode in itertools.product(PAIRS, (Mode.RTL, Mode.STEERING, Mode.HOLD)):
        boat = Boat(Mode.AUTO, {first: Mode.HOLD, second: mode})
        boat.tick(first)
        boat.tick()
        assert boat.tick(second) is mode, (first, second)


@pytest.mark.parametrize("order", ORDERED)
def test_an_order_overrules_all_faults_that_are_set_and_none_that_comes_later(order):
    for first, second in PAIRS:
        chosen = {first: Mode.HOLD, second: Mode.RTL}
        boat = Boat(Mode.AUTO, chosen, resume=True)
        boat.tick(first, second)
        assert boat.tick(first, second, order=order) is order
        assert boat.tick(second) is order
        came_back = chosen[first] if acts(first, order) else order
        assert boat.tick(first, second) is came_back, (first, second)
        # MANUAL does not resume.
        assert boat.tick() is (came_back if order is Mode.MANUAL else order)


def test_in_manual_only_the_loss_of_the_ground_station_acts():
    for fault in PRECEDENCE:
        if TABLE[fault].acts_in_manual:
            continue
        lost = Fault.STATION_SILENT
        boat = Boat(Mode.MANUAL, {lost: Mode.LOITER, fault: Mode.RTL})
        assert boat.tick(fault) is Mode.MANUAL
        first = min((fault, lost), key=PRECEDENCE.index)
        assert boat.tick(fault, lost) is (Mode.RTL if first is fault else Mode.LOITER)
        # A fault that was set when MANUAL was ordered does not act.
        boat = Boat(Mode.AUTO, {lost: Mode.LOITER, fault: Mode.RTL})
        boat.tick(fault)
        boat.tick(fault, order=Mode.MANUAL)
        assert boat.tick(fault, lost) is Mode.LOITER


def test_the_reports_of_a_hot_servo_a_low_supply_and_their_end():
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
