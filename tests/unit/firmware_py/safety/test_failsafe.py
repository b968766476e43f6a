"""Which fault decides the mode: the ladder, the gravest first, and the operator's later order."""

import pytest

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.latch import arming_refusal
from firmware_py.faults.table import TABLE, Fault
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.supervisor import SupervisorSettings

GCS, FENCE, VOLT = Fault.STATION_SILENT, Fault.FENCE_BREACHED, Fault.SUPPLY_LOW


class Helm:
    """A mode that failsafes change, as step() does it."""

    def __init__(self, mode=Mode.AUTO, armed=True, impossible=(), resume=True):
        self.mode, self.armed, self.impossible, self.resume = mode, armed, set(impossible), resume
        chosen = {GCS: Mode.LOITER, FENCE: Mode.RTL, VOLT: None}
        self.modes = chosen
        self.before = mode
        self.by_failsafe = False
        self.state = FailsafeState()
        self.said = []

    def tick(self, *faults, order=None):
        if order is not None:
            self.mode, self.by_failsafe = order, False
        active = sum(1 << fault for fault in faults)
        possible = lambda mode: mode not in self.impossible  # noqa: E731
        given = FailsafeInput(
            active, self.mode, self.by_failsafe, self.armed, order is not None, self.modes, possible, self.resume
        )
        acting = self.state.fault is not None
        self.state, decision = decide(self.state, given)
        if not acting:
            self.before = self.mode
        self.said += [event.text for event in decision.events]
        if decision.enter is not None:
            self.mode, self.by_failsafe = decision.enter, True
        if decision.resume:
            self.mode, self.by_failsafe = self.before, False
        return self.mode


def test_a_fault_changes_the_mode_once_and_what_was_done_goes_on_after_it():
    helm = Helm()
    assert helm.tick() is Mode.AUTO
    assert helm.tick(GCS) is Mode.LOITER
    assert helm.tick(GCS) is Mode.LOITER
    assert helm.said == ["Failsafe: LOITER"]
    assert helm.tick() is Mode.AUTO


def test_after_an_empty_battery_she_goes_on_whatever_the_parameter_says():
    helm = Helm(resume=False)
    helm.modes = {Fault.BATTERY_CRITICAL: Mode.STEERING}
    helm.tick()
    assert helm.tick(Fault.BATTERY_CRITICAL) is Mode.STEERING
    assert helm.tick() is Mode.AUTO


def test_without_resume_the_mode_stays_and_that_is_said():
    helm = Helm(resume=False)
    helm.tick(GCS)
    assert helm.tick() is Mode.LOITER
    assert helm.said[-1] == "Failsafe over: LOITER stays"


@pytest.mark.parametrize("order", [Mode.GUIDED, Mode.LOITER, Mode.MANUAL])
def test_the_operator_s_later_order_wins_as_long_as_the_fault_stands(order):
    helm = Helm()
    helm.tick(GCS)
    assert helm.tick(GCS, order=order) is order
    assert helm.tick(GCS) is order
    assert helm.tick() is order
    # Once it has gone and come back it acts again, unless she is in the operator's hands, and it is not their loss.
    assert helm.tick(GCS) is Mode.LOITER


@pytest.mark.parametrize(
    ("impossible", "mode"),
    [
        ((), Mode.RTL),
        ((Mode.RTL,), Mode.LOITER),
        ((Mode.RTL, Mode.LOITER), Mode.STEERING),
        (tuple(Mode), Mode.HOLD),
    ],
)
def test_an_impossible_mode_gives_way_to_the_next_of_the_ladder(impossible, mode):
    helm = Helm(impossible=impossible)
    assert helm.tick(FENCE) is mode
    assert helm.said == [f"Failsafe: {mode.name}" + ("" if mode is Mode.RTL else ", RTL is impossible")]


def test_a_better_mode_is_taken_once_it_is_possible_and_a_worse_one_is_not():
    helm = Helm(impossible=(Mode.RTL, Mode.LOITER))
    helm.tick(FENCE)
    helm.impossible = set()
    assert helm.tick(FENCE) is Mode.RTL
    helm.impossible = {Mode.RTL}
    assert helm.tick(FENCE) is Mode.RTL
    assert helm.tick() is Mode.AUTO


def test_the_gravest_fault_decides_and_the_other_one_after_it():
    helm = Helm()
    assert helm.tick(GCS) is Mode.LOITER
    assert helm.tick(GCS, FENCE) is Mode.RTL
    assert helm.tick(FENCE) is Mode.RTL
    assert helm.tick(GCS, FENCE) is Mode.RTL
    assert helm.tick(GCS) is Mode.LOITER
    assert helm.tick() is Mode.AUTO


@pytest.mark.parametrize(
    ("mode", "armed"), [(Mode.MANUAL, True), (Mode.HOLD, True), (Mode.AUTO, False), (Mode.GUIDED, False)]
)
def test_no_mode_is_entered_while_disarmed_or_in_manual_or_hold(mode, armed):
    helm = Helm(mode, armed)
    assert helm.tick(FENCE) is mode
    helm.armed = True
    assert helm.tick(FENCE, order=Mode.GUIDED) is Mode.GUIDED
    assert helm.said == []


def test_disarming_ends_a_failsafe():
    helm = Helm()
    helm.tick(FENCE)
    helm.armed = False
    helm.tick(FENCE)
    helm.armed = True
    assert helm.tick(FENCE, order=Mode.AUTO) is Mode.AUTO


def test_after_disarming_neither_the_fault_that_stands_acts_again_nor_goes_on_what_was_interrupted():
    helm = Helm()
    helm.tick(FENCE)
    helm.armed = False
    helm.tick(FENCE)
    helm.armed, helm.mode = True, Mode.STEERING
    assert helm.tick(FENCE) is Mode.STEERING
    assert helm.tick() is Mode.STEERING
    assert helm.said == ["Failsafe: RTL"]


def test_another_mode_that_nobody_here_chose_ends_a_failsafe():
    helm = Helm()
    helm.tick(GCS)
    helm.mode = Mode.STEERING
    assert helm.tick(GCS) is Mode.STEERING
    assert helm.tick() is Mode.STEERING
    assert helm.said == ["Failsafe: LOITER"]


def test_a_fault_set_to_alert_only_while_its_failsafe_acts_calls_for_nothing_any_more():
    helm = Helm(resume=False)
    helm.tick(GCS)
    helm.modes[GCS] = None
    assert helm.tick(GCS) is Mode.LOITER
    assert helm.said[-1] == "Failsafe over: LOITER stays"


def test_every_row_with_a_parameter_has_its_mode_and_every_default_is_one():
    modes = SupervisorSettings.of(ParameterSet()).failsafe_modes
    assert set(modes) == {fault for fault, row in TABLE.items() if row.parameter}
    assert (modes[Fault.FENCE_BREACHED], modes[Fault.SUPPLY_LOW]) == (Mode.RTL, None)


def test_the_table_says_what_forbids_arming():
    assert arming_refusal(0) == ""
    assert arming_refusal(1 << Fault.LOOP_LATE | 1 << Fault.RUDDER_JAMMED) == "rudder jammed"
    assert all(len(f"Arming refused: {row.arming_refusal}") <= 50 for row in TABLE.values())
