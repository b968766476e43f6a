"""Simulated hulls that differ from the model of the autopilot, for `rig.Sailing`."""

from functools import partial

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.ship.kt_plant import KtPlant
from support import rig


class MismatchedHull(rig.TickHull):
    """A hull with factors on K and T, a delayed rudder, a float with the compass on a tether, and a lost rudder.

    `float_dynamics`: natural frequency [rad/s] and damping of the float; None: it turns with the glider. `grip`: share
    of the rudder that acts; 0: the rudder is lost.
    """

    def __init__(self, scenario, seed, ability=1.0, lag=1.0, delay_s=0.0, float_dynamics=None):
        super().__init__(scenario, seed)
        scaled = OCEAN_RAMBLER.at_speed(scenario.speed_m_s)
        model = scaled._replace(
            turning_ability_1_s=scaled.turning_ability_1_s * ability,
            turning_lag_s=scaled.turning_lag_s * lag,
            rudder_offset_rad=scaled.rudder_offset_rad + radians(scenario.bias_deg),
        )
        self.plant = KtPlant(model, rig.STEP_S)
        self.delayed_rad = [0.0] * round(delay_s / rig.STEP_S)
        self.float_dynamics, self.grip = float_dynamics, 1.0
        self.float_rad = self.float_rad_s = 0.0

    def step(self, rudder_rad):
        self.delayed_rad.append(rudder_rad)
        super().step(self.grip * self.delayed_rad.pop(0))
        if self.float_dynamics is None:
            self.float_rad = self.plant.heading_rad
            return
        omega_rad_s, damping = self.float_dynamics
        part_s = 0.25 * rig.STEP_S
        for _ in range(4):
            difference_rad = self.plant.heading_rad - self.float_rad
            self.float_rad_s += part_s * omega_rad_s * (omega_rad_s * difference_rad - 2.0 * damping * self.float_rad_s)
            self.float_rad += part_s * self.float_rad_s

    def heading_rad(self, offset_s):
        return self.float_rad + self.waves.angle_rad(offset_s)


def mismatched_hull(**options):
    """Return a hull for `rig.Sailing`."""
    return partial(MismatchedHull, **options)
