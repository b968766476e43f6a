"""Simulated hull in the sea of a scenario, with a fixed time step.

The state advances on the grid k * GRID_S; between grid points values are read from the state at the start of the grid
step. A reading depends on its time alone, not on the times of other calls. So a run is identical, bit for bit, at any
speed and with any traffic on the links.
"""

from __future__ import annotations

from collections import deque

from firmware_py.common.angles import radians
from firmware_py.model.kt import KtModel, yaw_acceleration
from hil.ship.compass_error import CompassErrors
from hil.ship.disturbances import Bias, Disturbances, OwnWaves
from hil.ship.drift import TIME_CONSTANT_S, RudderDrift
from hil.ship.float_body import FollowingFloat
from hil.ship.gusts import Gusts
from hil.ship.kt_plant import KtPlant
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.orbit import Orbit, ShortCrestedOrbit
from hil.ship.planar import PlanarMotion, Tide
from hil.ship.scenarios import Scenario
from hil.ship.sideways import Sideways
from hil.ship.wave_speed import MAX_SPEED_RATIO, SpeedInWaves
from hil.ship.waves import DAMPING, WaveYaw
from hil.ship.yaw_noise import YawNoise, largest_rate_rad_s

STEPS_PER_SECOND = 50
GRID_S = 1.0 / STEPS_PER_SECOND
STEERAGE_M_S = 0.05  # below this speed T is constant and K is proportional to the speed


class PureDelay:
    """Delay values by a whole number of grid steps; the output is `start` until the first value arrives."""

    def __init__(self, delay_s: float, step_s: float, start: float = 0.0) -> None:
        """Round the delay to the nearest step."""
        self._values = deque([start] * round(delay_s / step_s))

    def step(self, value: float) -> float:
        """Add the value of this step and return the delayed one."""
        self._values.append(value)
        return self._values.popleft()


class Hull:
    """Heading, yaw rate, track and wave yaw; `offset_s` is the time since the start of the present grid step.

    With the disturbance `float` there are two bodies: the rudder turns the glider, which sets the course; the compass
    is on the float, which the waves yaw.
    """

    def __init__(self, scenario: Scenario, model: KtModel, seed: int) -> None:
        """Start at the origin heading north, at the scenario's speed, with the rudder amidships."""
        disturbances = scenario.disturbances
        self._ship_model = _ship_model_of(model, scenario, disturbances)
        self._model = self._ship_model.at_speed(scenario.speed_m_s)
        fastest_model = self._model
        if disturbances.wave_speed is not None:
            fastest_model = self._ship_model.at_speed(MAX_SPEED_RATIO * scenario.speed_m_s)
        noise_rad_s = 0.0
        if (yaw := disturbances.yaw) is not None:
            noise_rad_s = largest_rate_rad_s(yaw.diffusion_deg2_s, fastest_model.turning_lag_s)
        self._plant = KtPlant(fastest_model, GRID_S, disturbance_rad_s=noise_rad_s)
        self._plant.set_model(self._model)
        bias = disturbances.bias or Bias(scenario.drift_deg, TIME_CONSTANT_S)
        numbers = NormalNumbers(generator(seed, Stream.DRIFT))
        self._drift = RudderDrift(radians(bias.sd_deg), GRID_S, numbers, bias.memory_s)
        self._gusts = Gusts(radians(scenario.gust_deg), GRID_S, generator(seed, Stream.GUSTS))
        wave_yaw = disturbances.own_waves or OwnWaves(scenario.wave_period_s, DAMPING)
        numbers = NormalNumbers(generator(seed, Stream.WAVES))
        self._waves = WaveYaw(radians(scenario.wave_yaw_deg), wave_yaw.period_s, GRID_S, numbers, wave_yaw.damping)
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
        self._mean_speed_m_s = self.speed_m_s = scenario.speed_m_s
        self._rudder_rad = 0.0
        self._wave_ratio = 1.0  # wave amplitude relative to its mean
        self._add_disturbances(scenario, seed)

    def _add_disturbances(self, scenario: Scenario, seed: int) -> None:
        """Create the models of the disturbances that are present."""
        disturbances = scenario.disturbances
        self._delay = None if disturbances.delay is None else PureDelay(disturbances.delay.delay_s, GRID_S)
        self._yaw_noise: YawNoise | None = None
        if (yaw := disturbances.yaw) is not None:
            self._yaw_noise = YawNoise(yaw.diffusion_deg2_s, GRID_S, NormalNumbers(generator(seed, Stream.YAW)))
        self._float: FollowingFloat | None = None
        if (body := disturbances.float_body) is not None:
            self._float = FollowingFloat(body.own_frequency_rad_s, body.damping, GRID_S)
        self._sideways: Sideways | None = None
        if disturbances.leeway is not None or disturbances.slide is not None:
            self._sideways = Sideways(disturbances.leeway, disturbances.slide, GRID_S)
        self._short_crested: ShortCrestedOrbit | None = None
        if (orbital := disturbances.orbital) is not None:
            self._short_crested = ShortCrestedOrbit(
                orbital.velocity_m_s,
                radians(orbital.spread_deg),
                scenario.wave_period_s,
                radians(scenario.waves_toward_deg),
                GRID_S,
                # A wave yaw with its own period is independent of the orbital motion.
                (self._waves, radians(scenario.wave_yaw_deg) if disturbances.own_waves is None else 0.0),
                (NormalNumbers(generator(seed, Stream.ORBIT)), NormalNumbers(generator(seed, Stream.ORBIT_ALONE))),
                orbital.damping,
            )
        self._wave_speed: SpeedInWaves | None = None
        if disturbances.wave_speed is not None:
            self._wave_speed = SpeedInWaves(
                disturbances.wave_speed, GRID_S, NormalNumbers(generator(seed, Stream.SPEED))
            )
        self._compass: CompassErrors | None = None
        if disturbances.compass is not None:
            # Without waves there is no roll.
            heel_rad = radians(disturbances.compass.heel_deg) if scenario.wave_period_s > 0.0 else 0.0
            roll = WaveYaw(heel_rad, scenario.wave_period_s, GRID_S, NormalNumbers(generator(seed, Stream.ROLL)))
            self._compass = CompassErrors(disturbances.compass, GRID_S, roll)

    def step(self, rudder_rad: float) -> None:
        """Advance one grid step that ends with the rudder at rudder_rad.

        The plant is driven by the mean of the rudder at both ends. The slew of the rudder is limited, so the error
        is of second order in the grid step.
        """
        if self._delay is not None:
            rudder_rad = self._delay.step(rudder_rad)
        previous_rad = self._plant.heading_rad
        self._plant.step(0.5 * (self._rudder_rad + rudder_rad), self._disturbance_rudder_rad())
        if self._yaw_noise is not None:
            self._plant.yaw_rate_rad_s += self._yaw_noise.jump_rad_s(self._model.turning_lag_s)
        middle_rad = 0.5 * (previous_rad + self._plant.heading_rad)
        if self._sideways is not None:
            self._track.sideways_m_s = self._sideways.step(middle_rad, self._plant.yaw_rate_rad_s, self.speed_m_s)
        self._track.step(middle_rad, (self._steps + 0.5) * GRID_S, GRID_S)
        self._steps += 1
        self._drift.step()
        self._gusts.step()
        self._waves.step()
        self._orbit.step()
        self._rudder_rad = rudder_rad
        if self._float is not None:
            self._float.step(middle_rad)
        if self._short_crested is not None:
            self._short_crested.step()
        if self._wave_speed is not None:
            self._update_speed(self._wave_speed)
        if self._compass is not None:
            self._compass.step(self.heading_rad(0.0))

    def add_heading(self, angle_rad: float) -> None:
        """Change the heading at once, as a collision does."""
        self._plant.heading_rad += angle_rad

    def _update_speed(self, wave_speed: SpeedInWaves) -> None:
        wave_speed.step(self._steps * GRID_S)
        self._wave_ratio = wave_speed.wave_ratio
        if self._compass is not None:
            self._compass.roll_ratio = wave_speed.wave_ratio
        self.speed_m_s = self._track.speed_m_s = self._mean_speed_m_s * wave_speed.speed_ratio
        model = self._ship_model.at_speed(max(self.speed_m_s, STEERAGE_M_S))
        if self.speed_m_s < STEERAGE_M_S:
            model = model._replace(turning_ability_1_s=model.turning_ability_1_s * self.speed_m_s / STEERAGE_M_S)
        self._model = model
        self._plant.set_model(model)

    def glider_heading_rad(self, offset_s: float) -> float:
        """Return the heading of the body with the rudder, unwrapped; with one body the heading without wave yaw."""
        rate_rad_s = self._plant.yaw_rate_rad_s
        return self._plant.heading_rad + offset_s * (rate_rad_s + 0.5 * offset_s * self._yaw_acceleration())

    def float_heading_rad(self, offset_s: float) -> float:
        """Return the heading of the float, which has the compass, without wave yaw, unwrapped."""
        body = self._float
        if body is None:
            return self.glider_heading_rad(offset_s)
        acceleration = body.yaw_acceleration(self._plant.heading_rad)
        return body.heading_rad + offset_s * (body.yaw_rate_rad_s + 0.5 * offset_s * acceleration)

    def heading_low_rad(self, offset_s: float) -> float:
        """Return the hull's heading without wave yaw, unwrapped.

        It is the course through the water if the disturbances `leeway` and `sway` are absent.
        """
        return self.glider_heading_rad(offset_s)

    def heading_rad(self, offset_s: float) -> float:
        """Return the heading of a perfect compass, unwrapped."""
        if self._float is None and self._wave_speed is None:
            return self.heading_low_rad(offset_s) + self._waves.angle_rad(offset_s)
        return self.float_heading_rad(offset_s) + self._wave_ratio * self._waves.angle_rad(offset_s)

    def compass_heading_rad(self, offset_s: float) -> float:
        """Return the heading output of the compass, unwrapped; perfect unless the disturbance `compass` is present."""
        heading_rad = self.heading_rad(offset_s)
        return heading_rad if self._compass is None else self._compass.output_rad(heading_rad, offset_s)

    def yaw_rate_low_rad_s(self, offset_s: float) -> float:
        """Return the hull's yaw rate without wave yaw."""
        return self._plant.yaw_rate_rad_s + offset_s * self._yaw_acceleration()

    def yaw_rate_rad_s(self, offset_s: float) -> float:
        """Return the output of a perfect gyroscope beside the compass."""
        body = self._float
        if body is None:
            return self.yaw_rate_low_rad_s(offset_s) + self._wave_ratio * self._waves.rate_rad_s(offset_s)
        low_rad_s = body.yaw_rate_rad_s + offset_s * body.yaw_acceleration(self._plant.heading_rad)
        return low_rad_s + self._wave_ratio * self._waves.rate_rad_s(offset_s)

    def velocity_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity over the ground, north and east."""
        return self._track.velocity_m_s(self.heading_low_rad(offset_s), self._steps * GRID_S + offset_s)

    def position_m(self, offset_s: float) -> tuple[float, float]:
        """Return the position north and east of the start."""
        north_m_s, east_m_s = self.velocity_m_s(0.5 * offset_s)
        return self._track.north_m + north_m_s * offset_s, self._track.east_m + east_m_s * offset_s

    def velocity_in_waves_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity over the ground including the orbital motion of the waves, north and east."""
        north_m_s, east_m_s = self.velocity_m_s(offset_s)
        if self._short_crested is None:
            wave_north_m_s, wave_east_m_s = self._orbit.velocity_m_s(offset_s)
        else:
            heading_rad = self.float_heading_rad(offset_s)
            wave_north_m_s, wave_east_m_s = self._short_crested.velocity_m_s(offset_s, heading_rad)
        return north_m_s + self._wave_ratio * wave_north_m_s, east_m_s + self._wave_ratio * wave_east_m_s

    def position_in_waves_m(self, offset_s: float) -> tuple[float, float]:
        """Return the position north and east of the start including the orbital motion of the waves."""
        north_m, east_m = self.position_m(offset_s)
        if self._short_crested is None:
            wave_north_m, wave_east_m = self._orbit.position_m(offset_s)
        else:
            wave_north_m, wave_east_m = self._short_crested.position_m(offset_s, self.float_heading_rad(offset_s))
        return north_m + self._wave_ratio * wave_north_m, east_m + self._wave_ratio * wave_east_m

    def _yaw_acceleration(self) -> float:
        model = self._model
        return yaw_acceleration(
            self._plant.yaw_rate_rad_s,
            self._rudder_rad,
            model.turning_ability_1_s,
            model.turning_lag_s,
            model.norrbin_s2,
            model.rudder_offset_rad + self._disturbance_rudder_rad(),
        )

    def _disturbance_rudder_rad(self) -> float:
        """Return the variation of the rudder bias by drift and gusts."""
        return self._drift.angle_rad + self._gusts.angle_rad


def _ship_model_of(model: KtModel, scenario: Scenario, disturbances: Disturbances) -> KtModel:
    """Return the model of the ship, with rudder bias and model mismatch, at the reference speed of `model`."""
    ship = model._replace(rudder_offset_rad=model.rudder_offset_rad + radians(scenario.bias_deg))
    if (other := disturbances.other_ship) is None:
        return ship
    return ship._replace(
        turning_ability_1_s=ship.turning_ability_1_s * other.ability, turning_lag_s=ship.turning_lag_s * other.lag
    )
