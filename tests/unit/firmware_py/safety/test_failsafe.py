"""Failsafes: ladder of modes, order of precedence, and orders of the operator."""

import pytest

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.latch import arming_refusal
from firmware_py.faults.table import TABLE, Fault
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.supervisor import SupervisorSettings

GCS, FENCE, VOLT = Fault.STATION_SILENT, Fault.FENCE_BREACHED, Fault.SUPPLY_LOW


class Boat:
    """A boat whose mode failsafes change, as in step()."""

    def __init__(self, mode=Mode.AUTO, armed=True, impossible=(), resume=True, modes=None):
        self.mode, self.armed, self.impossible, self.resume = mode, armed, impossible, resume
        self.modes = {GCS: Mode.LOITER, FENCE: Mode.RTL, VOLT: None} if modes is None else modes
        self.before, self.by_failsafe = mode, False
        self.state, self.texts = FailsafeState(), []

    def tick(self, *faults, order=None, **changes):
        """Change attributes, take an order, and return the mode with these faults set."""
        for name, value in changes.items():
            setattr(self, name, value)
        if order is not None:
            self.mode, self.by_failsafe = order, False
        active = sum(1 << fault for fault in faults)
        possible = lambda mode: mode not in self.impossible  # noqa: E731
        inputs = FailsafeInput(
            active, self.mode, self.by_failsafe, self.armed, order is not None, self.modes, possible, self.resume
        )
        acting = self.state.fault is not None
        self.state, decision = decide(self.state, inputs)
        if not acting:
            self.before = self.mode
        self.texts += [event.text for event in decision.events]
        if decision.enter is not None:
            self.mode, self.by_failsafe = decision.enter, True
        if decision.resume:
            self.mode, self.by_failsafe = self.before, False
        return self.mode


def test_a_fault_changes_the_mode_once_and_the_interrupted_mode_resumes():
    boat = Boat()
    assert [boat.tick(), boat.tick(GCS), boat.tick(GCS), boat.tick()] == [
        Mode.AUTO,
        Mode.LOITER,
        Mode.LOITER,
        Mode.AUTO,
    ]
    assert boat.texts == ["Failsafe: LOITER"]


def test_after_a_critical_battery_the_mode_resumes_without_fs_resume():
    boat = Boat(resume=False, modes={Fault.BATTERY_CRITICAL: Mode.STEERING})
    assert [boat.tick(), boat.tick(Fault.BATTERY_CRITICAL), boat.tick()] == [Mode.AUTO, Mode.STEERING, Mode.AUTO]


@pytest.mark.parametrize("end", ["the fault clears", "alert only"])
def test_without_fs_resume_the_mode_is_kept_and_reported(end):
    boat = Boat(resume=False)
    boat.tick(GCS)
    mode = boat.tick() if end == "the fault clears" else boat.tick(GCS, modes={GCS: None})
    assert (mode, boat.texts[-1]) == (Mode.LOITER, "Failsafe ended: LOITER stays until a mode is set")


@pytest.mark.parametrize("order", [Mode.GUIDED, Mode.LOITER, Mode.MANUAL])
def test_a_later_order_of_the_operator_overrules_the_fault(order):
    boat = Boat()
    boat.tick(GCS)
    assert boat.tick(GCS, order=order) is order
    assert boat.tick(GCS) is order
    assert boat.tick() is order
    # Set again after it has cleared, it acts, but in MANUAL only the loss of the ground station does.
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
def test_an_impossible_mode_is_replaced_by_the_next_of_the_ladder(impossible, mode):
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


def test_a_better_mode_is_taken_once_it_is_possible_and_a_worse_one_is_not():
    boat = Boat(impossible=(Mode.RTL, Mode.LOITER))
    assert boat.tick(FENCE) is Mode.STEERING
    assert boat.tick(FENCE, impossible=()) is Mode.RTL
    assert boat.tick(FENCE, impossible=(Mode.RTL,)) is Mode.RTL
    assert boat.tick() is Mode.AUTO


def test_the_most_severe_fault_decides_and_the_other_one_after_it():
    boat = Boat()
    modes = [boat.tick(*faults) for faults in ((GCS,), (GCS, FENCE), (FENCE,), (GCS, FENCE), (GCS,), ())]
    assert modes == [Mode.LOITER, Mode.RTL, Mode.RTL, Mode.RTL, Mode.LOITER, Mode.AUTO]


@pytest.mark.parametrize("disarmed", [True, False])
def test_disarming_or_a_mode_change_from_elsewhere_ends_a_failsafe(disarmed):
    boat = Boat()
    boat.tick(GCS)
    if disarmed:
        boat.tick(GCS, armed=False)
    assert boat.tick(GCS, armed=True, mode=Mode.STEERING) is Mode.STEERING
    assert boat.tick() is Mode.STEERING
    assert boat.texts == ["Failsafe: LOITER"]


def test_a_fault_overruled_by_disarming_does_not_act_in_an_ordered_mode():
    boat = Boat()
    boat.tick(FENCE)
    boat.tick(FENCE, armed=False)
    assert boat.tick(FENCE, armed=True, order=Mode.AUTO) is Mode.AUTO


def test_every_parameter_of_a_row_has_a_mode_and_a_valid_default():
    modes = SupervisorSettings.of(ParameterSet()).failsafe_modes
    assert set(modes) == {fault for fault, row in TABLE.items() if row.parameter}
    assert (modes[Fault.FENCE_BREACHED], modes[Fault.SUPPLY_LOW]) == (Mode.RTL, None)


def test_the_table_has_the_reasons_that_refuse_arming():
    assert arming_refusal(0) == ""
    assert arming_refusal(1 << Fault.LOOP_LATE | 1 << Fault.RUDDER_JAMMED) == "rudder jammed"
    assert all(len(f"Arming refused: {row.arming_refusal}") <= 50 for row in TABLE.values())
