"""The hull in a scenario's sea, on one fixed grid of time.

Everything that moves by itself advances on the grid k * GRID_S and is read in between from
the state at the start of the grid step. So what a device reads at some moment depends on
that moment alone, never on how the run was cut into calls: a run is the same, bit for bit,
at any speed and with any traffic on the lines.
"""

from __future__ import annotations

from dataclasses import replace

from firmware_py.common.angles import radians
from firmware_py.model.kt import KtModel, yaw_acceleration
from hil.ship.drift import RudderDrift
from hil.ship.gusts import Gusts
from hil.ship.kt_plant import KtPlant
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.orbit import Orbit
from hil.ship.planar import PlanarMotion
from hil.ship.scenarios import Scenario
from hil.ship.tide import Tide
from hil.ship.waves import WaveYaw

STEPS_PER_SECOND = 50
GRID_S = 1.0 / STEPS_PER_SECOND


class Hull:
    """Heading, yaw rate, track and wave yaw; `offset` arguments are seconds into the present grid step."""

    def __init__(self, scenario: Scenario, model: KtModel, seed: int) -> None:
        """Lie at the origin heading north, under way at the scenario's speed, the rudder amidships."""
        scaled = model.at_speed(scenario.speed_m_s)
        self._model = replace(scaled, rudder_offset_rad=scaled.rudder_offset_rad + radians(scenario.bias_deg))
        self._plant = KtPlant(self._model, GRID_S)
        self._drift = RudderDrift(radians(scenario.drift_deg), GRID_S, NormalNumbers(generator(seed, Stream.DRIFT)))
        self._gusts = Gusts(radians(scenario.gust_deg), GRID_S, generator(seed, Stream.GUSTS))
        self._waves = WaveYaw(
            radians(scenario.wave_yaw_deg),
            scenario.wave_period_s,
            GRID_S,
            NormalNumbers(generator(seed, Stream.WAVES)),
        )
        self._orbit = Orbit(
            scenario.orbital_m_s,
            scenario.wave_period_s,
            radians(scenario.waves_toward_deg),
            GRID_S,
            NormalNumbers(generator(seed, Stream.ORBIT)),
        )
        self._track = PlanarMotion(
            scenario.speed_m_s,
            Tide(scenario.current_m_s, radians(scenario.current_toward_deg), scenario.tide_s, scenario.tide_rotary),
        )
        self._steps = 0
        self.speed_m_s = scenario.speed_m_s
        self._rudder_rad = 0.0

    def step(self, rudder_rad: float) -> None:
        """Advance one grid step that ends with the rudder at rudder_rad.

        The plant is driven by the mean of both ends: the rudder moves at a limited slew,
        so what that leaves out is of the second order in the grid step.
        """
        before_rad = self._plant.heading_rad
        self._plant.step(0.5 * (self._rudder_rad + rudder_rad), self._offset_rad())
        self._track.step(0.5 * (before_rad + self._plant.heading_rad), (self._steps + 0.5) * GRID_S, GRID_S)
        self._steps += 1
        self._drift.step()
        self._gusts.step()
        self._waves.step()
        self._orbit.step()
        self._rudder_rad = rudder_rad

    def heading_low_rad(self, offset_s: float) -> float:
        """Return the hull's heading without the yaw of the waves, unwrapped."""
        rate_rad_s = self._plant.yaw_rate_rad_s
        return self._plant.heading_rad + offset_s * (rate_rad_s + 0.5 * offset_s * self._yaw_acceleration())

    def heading_rad(self, offset_s: float) -> float:
        """Return the heading that a perfect compass shows, unwrapped."""
        return self.heading_low_rad(offset_s) + self._waves.angle_rad(offset_s)

    def yaw_rate_low_rad_s(self, offset_s: float) -> float:
        """Return the hull's yaw rate without the yaw of the waves."""
        return self._plant.yaw_rate_rad_s + offset_s * self._yaw_acceleration()

    def yaw_rate_rad_s(self, offset_s: float) -> float:
        """Return the yaw rate that a perfect gyroscope shows."""
        return self.yaw_rate_low_rad_s(offset_s) + self._waves.rate_rad_s(offset_s)

    def velocity_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity over the ground, north and east."""
        return self._track.velocity_m_s(self.heading_low_rad(offset_s), self._steps * GRID_S + offset_s)

    def position_m(self, offset_s: float) -> tuple[float, float]:
        """Return the position north and east of the start."""
        north_m_s, east_m_s = self.velocity_m_s(0.5 * offset_s)
        return self._track.north_m + north_m_s * offset_s, self._track.east_m + east_m_s * offset_s

    def velocity_in_waves_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity over the ground with that of the waves, north and east."""
        (north_m_s, east_m_s), (more_north_m_s, more_east_m_s) = (
            self.velocity_m_s(offset_s),
            self._orbit.velocity_m_s(offset_s),
        )
        return north_m_s + more_north_m_s, east_m_s + more_east_m_s

    def position_in_waves_m(self, offset_s: float) -> tuple[float, float]:
        """Return the position north and east of the start as the waves move the boat to and fro."""
        (north_m, east_m), (more_north_m, more_east_m) = self.position_m(offset_s), self._orbit.position_m(offset_s)
        return north_m + more_north_m, east_m + more_east_m

    def _yaw_acceleration(self) -> float:
        model = self._model
        return yaw_acceleration(
            self._plant.yaw_rate_rad_s,
            self._rudder_rad,
            model.turning_ability_1_s,
            model.turning_lag_s,
            model.norrbin_s2,
            model.rudder_offset_rad + self._offset_rad(),
        )

    def _offset_rad(self) -> float:
        """The rudder angle that drift and gusts add now."""
        return self._drift.angle_rad + self._gusts.angle_rad
