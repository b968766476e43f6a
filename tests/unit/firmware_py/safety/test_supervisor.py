"""End of a failsafe whose mode cannot resume, and limit of the rudder without a heading."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault
from firmware_py.modes import ModeState, Situation
from firmware_py.safety.failsafe import FailsafeState
from firmware_py.safety.supervisor import SupervisorSettings, SupervisorState, apply_failsafe, limit_without_heading

NO_HOME = Situation(1.0, None, position_ok=True, rudder_ok=True)


def test_text_of_a_mode_that_cannot_resume_has_at_most_50_characters():
    failsafe = FailsafeState(fault=Fault.STATION_SILENT, mode=Mode.LOITER)
    state = SupervisorState(failsafe=failsafe, interrupted=ModeState(Mode.RTL, armed=True))
    settings = replace(SupervisorSettings.of(ParameterSet()), resume=True)
    modes = ModeState(Mode.LOITER, armed=True, by_failsafe=True)
    state = replace(state, failsafe=replace(failsafe, active=1 << Fault.STATION_SILENT))
    later, kept, (event,) = apply_failsafe(settings, state, modes, 0, NO_HOME, overruled=False)
    assert event.text == "Failsafe ended: LOITER kept, no home and no rally "
    assert (later, kept) == (SupervisorState(), modes)


GUIDED = ModeState(Mode.GUIDED, armed=True)
IDLE = SupervisorState()
BEGUN = SupervisorState(hard_over_s=100.0)
CENTRED = SupervisorState(kept_amidships=True)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("state", "command_deg", "now_s", "next_state", "is_centred"),
    [
        (IDLE, 7.9, 100.0, IDLE, False),
        (IDLE, 8.1, 100.0, BEGUN, False),
        (BEGUN, 8.1, 129.9, BEGUN, False),
        (BEGUN, 8.1, 130.0, CENTRED, True),
        (BEGUN, 7.9, 131.0, IDLE, False),
        (CENTRED, 0.0, 131.0, CENTRED, True),
    ],
)
def test_rudder_command_above_8_deg_for_30_s_without_a_heading_is_centred(
    state, command_deg, now_s, next_state, is_centred, side
):
    command_rad = side * math.radians(command_deg)
    result = limit_without_heading(state, 0.3, command_rad, GUIDED, now_s, has_heading=False)
    assert result == (next_state, 0.0 if is_centred else 0.3)


@pytest.mark.parametrize("state", [IDLE, BEGUN, CENTRED])
@pytest.mark.parametrize(
    ("modes", "has_heading"),
    [(GUIDED, True), (replace(GUIDED, armed=False), False), (replace(GUIDED, mode=Mode.MANUAL), False)],
)
def test_limit_ends_with_a_heading_while_disarmed_and_in_manual(state, modes, has_heading):
    result = limit_without_heading(state, 0.3, 0.3, modes, 131.0, has_heading=has_heading)
    assert result == (IDLE, 0.3)
