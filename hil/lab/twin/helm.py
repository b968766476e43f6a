"""The heading controller in the compiled loop: the firmware's law (firmware_py/control/law.py) on rows of numbers."""

from __future__ import annotations

from firmware_py.model.heading_estimate import HeadingEstimate
from hil.lab.compiled import compiled
from hil.lab.numeric_core import law
from hil.lab.twin.kalman import Floats

# Columns of the estimate in a tick.
E_HEADING, E_CORRECTION, E_RATE, E_BIAS, E_SPEED, E_SPEED_SD, E_FACTOR, E_HEADING_SD, E_BIAS_MEAN = range(9)
KNOWN = 9
# Columns of the controller's state; NaN stands for None.
REF_HEADING, REF_RATE, FEEDFORWARD, FOLLOWED_BIAS = range(4)
HELM_STATES = 4


@compiled
def steer(
    settings: law.LawSettings,
    state: Floats,
    e: Floats,
    error_rad: float,
    command_rad: float,
    step_s: float,
    gain_reduction: float,
) -> float:
    """Return the rudder demand of a tick, and advance the controller's state."""
    before = law.LawState(law.Reference(state[REF_HEADING], state[REF_RATE], state[FEEDFORWARD]), state[FOLLOWED_BIAS])
    known = HeadingEstimate(
        e[E_HEADING], e[E_CORRECTION], e[E_RATE], e[E_BIAS], e[E_BIAS_MEAN], e[E_SPEED], e[E_SPEED_SD], e[E_FACTOR]
    )
    after, demand_rad = law.steer(settings, before, known, error_rad, command_rad, step_s, gain_reduction)
    state[REF_HEADING], state[REF_RATE] = after.reference.heading_rad, after.reference.yaw_rate_rad_s
    state[FEEDFORWARD], state[FOLLOWED_BIAS] = after.reference.feedforward_rad, after.bias_rad
    return demand_rad
