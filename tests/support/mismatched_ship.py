"""Simulated ships that differ from the ship model of the autopilot, for `rig.Sailing`."""

from functools import partial

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.ship.kt_plant import KtPlant
from support import rig


class IllHull(rig.TickHull):
    """K and T by a factor, a rudder that acts late, a float on a soft tether that the compass turns with, a lost blade.

    `follows`: natural frequency [rad/s] and damping with which the float follows the glider. `grip` is the part of the
    rudder that acts: 0 once the blade is gone.
    """

    def __init__(self, scenario, seed, ability=1.0, lag=1.0, delay_s=0.0, follows=None):
        super().__init__(scenario, seed)
        scaled = OCEAN_RAMBLER.at_speed(scenario.speed_m_s)
        model = scaled._replace(
            turning_ability_1_s=scaled.turning_ability_1_s * ability,
            turning_lag_s=scaled.turning_lag_s * lag,
            rudder_offset_rad=scaled.rudder_offset_rad + radians(scenario.bias_deg),
        )
        self.plant = KtPlant(model, rig.STEP_S)
        self.late = [0.0] * round(delay_s / rig.STEP_S)
        self.follows, self.grip = follows, 1.0
        self.float_rad = self.float_rad_s = 0.0

    def step(self, rudder_rad):
        self.late.append(rudder_rad)
        super().step(self.grip * self.late.pop(0))
        if self.follows is None:
            self.float_rad = self.plant.heading_rad
            return
        omega_rad_s, damping = self.follows
        part_s = 0.25 * rig.STEP_S
        for _ in range(4):
            behind_rad = self.plant.heading_rad - self.float_rad
            self.float_rad_s += part_s * omega_rad_s * (omega_rad_s * behind_rad - 2.0 * damping * self.float_rad_s)
            self.float_rad += part_s * self.float_rad_s

    def heading_rad(self, offset_s):
        return self.float_rad + self.waves.angle_rad(offset_s)


def mismatched(**how):
    """What `rig.Sailing` takes as its hull."""
    return partial(IllHull, **how)
