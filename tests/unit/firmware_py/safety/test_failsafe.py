"""Failsafes: ladder of modes, precedence of faults, and orders of the operator."""

import pytest

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.latch import arming_refusal
from firmware_py.faults.table import TABLE, Fault
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.supervisor import SupervisorSettings

GCS, FENCE, VOLT = Fault.STATION_SILENT, Fault.FENCE_BREACHED, Fault.SUPPLY_LOW


class Boat:
    """A boat whose mode the failsafes change, as in core/step.py."""

    def __init__(self, mode=Mode.AUTO, armed=True, impossible=(), resume=True, modes=None):
        self.mode, self.armed, self.impossible, self.resume = mode, armed, impossible, resume
        self.modes = {GCS: Mode.LOITER, FENCE: Mode.RTL, VOLT: None} if modes is None else modes
        self.interrupted, self.by_failsafe = mode, False
        self.state, self.texts = FailsafeState(), []

    def tick(self, *faults, order=None, **changes):
        """Change attributes, apply an order, and return the mode with these faults active."""
        for name, value in changes.items():
            setattr(self, name, value)
        if order is not None:
            self.mode, self.by_failsafe = order, False
        active = sum(1 << fault for fault in faults)
        possible = lambda mode: mode not in self.impossible  # noqa: E731
        inputs = FailsafeInput(
            active, self.mode, self.by_failsafe, self.armed, order is not None, self.modes, possible, self.resume
        )
        is_acting = self.state.fault is not None
        self.state, decision = decide(self.state, inputs)
        if not is_acting:
            self.interrupted = self.mode
        self.texts += [event.text for event in decision.events]
        if decision.enter is not None:
            self.mode, self.by_failsafe = decision.enter, True
        if decision.resume:
            self.mode, self.by_failsafe = self.interrupted, False
        return self.mode


def test_fault_changes_the_mode_once_and_the_interrupted_mode_resumes():
    boat = Boat()
    modes = [boat.tick(*faults) for faults in ((), (GCS,), (GCS,), ())]
    assert modes == [Mode.AUTO, Mode.LOITER, Mode.LOITER, Mode.AUTO]
    assert boat.texts == ["Failsafe: LOITER"]


def test_mode_resumes_after_a_critical_battery_without_fs_resume():
    boat = Boat(resume=False, modes={Fault.BATTERY_CRITICAL: Mode.STEERING})
    assert [boat.tick(), boat.tick(Fault.BATTERY_CRITICAL), boat.tick()] == [Mode.AUTO, Mode.STEERING, Mode.AUTO]


@pytest.mark.parametrize("end", ["the fault clears", "alert only"])
def test_mode_stays_without_fs_resume_and_is_reported(end):
    boat = Boat(resume=False)
    boat.tick(GCS)
    mode = boat.tick() if end == "the fault clears" else boat.tick(GCS, modes={GCS: None})
    assert (mode, boat.texts[-1]) == (Mode.LOITER, "Failsafe ended: LOITER stays until a mode is set")


@pytest.mark.parametrize("order", [Mode.GUIDED, Mode.LOITER, Mode.MANUAL])
def test_later_order_of_the_operator_overrules_the_fault(order):
    boat = Boat()
    boat.tick(GCS)
    assert boat.tick(GCS, order=order) is order
    assert boat.tick(GCS) is order
    assert boat.tick() is order
    # After it has cleared, the fault acts again; in MANUAL only the loss of the ground station does.
    assert boat.tick(GCS) is Mode.LOITER


@pytest.mark.parametrize(
    ("impossible", "mode"),
    [
        ((), Mode.RTL),
        ((Mode.RTL,), Mode.LOITER),
        ((Mode.RTL, Mode.LOITER), Mode.STEERING),
        (tuple(Mode), Mode.HOLD),
    ],
)
def test_impossible_mode_is_replaced_by_the_next_of_the_ladder(impossible, mode):
    boat = Boat(impossible=impossible)
    assert boat.tick(FENCE) is mode
    assert boat.texts == [f"Failsafe: {mode.name}" + ("" if mode is Mode.RTL else ", RTL not possible")]


@pytest.mark.parametrize(
    ("mode", "armed"), [(Mode.MANUAL, True), (Mode.HOLD, True), (Mode.AUTO, False), (Mode.GUIDED, False)]
)
def test_no_mode_is_entered_while_disarmed_or_in_manual_or_hold(mode, armed):
    boat = Boat(mode, armed)
    assert boat.tick(FENCE) is mode
    boat.armed = True
    assert boat.tick(FENCE, order=Mode.GUIDED) is Mode.GUIDED
    assert boat.texts == []


def test_better_mode_is_entered_once_possible_and_a_worse_one_is_not():
    boat = Boat(impossible=(Mode.RTL, Mode.LOITER))
    assert boat.tick(FENCE) is Mode.STEERING
    assert boat.tick(FENCE, impossible=()) is Mode.RTL
    assert boat.tick(FENCE, impossible=(Mode.RTL,)) is Mode.RTL
    assert boat.tick() is Mode.AUTO


def test_most_severe_fault_decides_until_it_clears():
    boat = Boat()
    modes = [boat.tick(*faults) for faults in ((GCS,), (GCS, FENCE), (FENCE,), (GCS, FENCE), (GCS,), ())]
    assert modes == [Mode.LOITER, Mode.RTL, Mode.RTL, Mode.RTL, Mode.LOITER, Mode.AUTO]


@pytest.mark.parametrize("is_disarmed", [True, False])
def test_disarming_or_another_mode_change_ends_a_failsafe(is_disarmed):
    boat = Boat()
    boat.tick(GCS)
    if is_disarmed:
        boat.tick(GCS, armed=False)
    assert boat.tick(GCS, armed=True, mode=Mode.STEERING) is Mode.STEERING
    assert boat.tick() is Mode.STEERING
    assert boat.texts == ["Failsafe: LOITER"]


def test_fault_overruled_by_disarming_does_not_act_in_an_ordered_mode():
    boat = Boat()
    boat.tick(FENCE)
    boat.tick(FENCE, armed=False)
    assert boat.tick(FENCE, armed=True, order=Mode.AUTO) is Mode.AUTO


def test_each_failsafe_parameter_has_a_valid_default():
    modes = SupervisorSettings.of(ParameterSet()).failsafe_modes
    assert set(modes) == {fault for fault, row in TABLE.items() if row.parameter}
    assert (modes[Fault.FENCE_BREACHED], modes[Fault.SUPPLY_LOW]) == (Mode.RTL, None)


def test_reasons_of_an_arming_refusal_come_from_the_table():
    assert arming_refusal(0) == ""
    assert arming_refusal(1 << Fault.LOOP_LATE | 1 << Fault.RUDDER_JAMMED) == "rudder jammed"
    assert all(len(f"Arming refused: {row.arming_refusal}") <= 50 for row in TABLE.values())
