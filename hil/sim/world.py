"""The world: ship, sea and rudder shaft, which can be advanced to any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import TWO_PI, radians, wrap_two_pi
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.devices.emulator import METRES_PER_DEGREE
from hil.ship import traffic
from hil.ship.disturbances import Depth, Wind
from hil.ship.hull import GRID_S, STEPS_PER_SECOND, Hull
from hil.ship.scenarios import Scenario
from hil.ship.servo import ServoShaft
from hil.sim.goals import Goal
from hil.sim.truth import FLOAT_COLUMN, ROWS_PER_SECOND, Row, Rows

START_UTC_S = 1_767_225_600.0  # 2026-01-01 00:00:00
START_LATITUDE_DEG = 36.0
START_LONGITUDE_DEG = 121.0
STOP_RAD = radians(45.0)  # to either side of amidships
STEPS_PER_ROW = STEPS_PER_SECOND // ROWS_PER_SECOND


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting of compass and servo; the corrections in the vehicle file compensate it.

    The rudder angle is the shaft's angle less rudder_centre_rad, negated when reversed; the compass output is the true
    heading less compass_offset_rad.
    """

    rudder_centre_rad: float = 0.0
    rudder_reversed: bool = False
    compass_offset_rad: float = 0.0

    def rudder_rad(self, shaft_rad: float) -> float:
        """Return the angle of the rudder at a shaft angle."""
        relative_rad = shaft_rad - self.rudder_centre_rad
        return -relative_rad if self.rudder_reversed else relative_rad


class CommandedShaft:
    """The shaft of a servo with the target that its electronics have set."""

    def __init__(self, shaft: ServoShaft) -> None:
        """Start with the present angle as target."""
        self._shaft = shaft
        self.target_rad = shaft.angle_rad()

    def angle_rad(self) -> float:
        """Return the true angle of the shaft now."""
        return self._shaft.angle_rad()

    def set_target(self, target_rad: float) -> None:
        """Move toward this angle from now on."""
        if math.isfinite(target_rad):
            self.target_rad = target_rad
        self._shaft.set_target(target_rad)

    def set_torque(self, *, on: bool) -> None:
        """Release or engage the motor."""
        self._shaft.set_torque(on=on)


def extra_columns(scenario: Scenario) -> tuple[str, ...]:
    """Return the additional columns of truth.csv in this scenario."""
    return () if scenario.disturbances.float_body is None else (FLOAT_COLUMN,)


class World:
    """The plant: everything except the electronics. It implements Surroundings for the emulators.

    `advance_to` advances all of it to a time; the emulators then read and act at that time. The truth is recorded
    until `end_s` in `truth`, by default a list. `start_utc_s` is UTC at time 0, as the receiver reports it.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        goals: Sequence[Goal] = (),
        *,
        end_s: float = math.inf,
        model: KtModel = OCEAN_RAMBLER,
        mounting: Mounting | None = None,
        truth: Rows | None = None,
        start_utc_s: float = START_UTC_S,
    ) -> None:
        """Start at time 0 with the rudder amidships; raise ValueError for an invalid ship model."""
        self._mounting = mounting or Mounting()
        centre_rad = self._mounting.rudder_centre_rad
        self._mechanics = ServoShaft(
            angle_rad=centre_rad, low_stop_rad=centre_rad - STOP_RAD, high_stop_rad=centre_rad + STOP_RAD
        )
        self.shaft = CommandedShaft(self._mechanics)
        no_rows: list[Row] = []
        self.truth: Rows = no_rows if truth is None else truth
        # With two bodies the heading of the float is recorded in an additional column.
        self._has_two_bodies = bool(extra_columns(scenario))
        self.rudder_effect = 1.0  # share of the rudder angle that turns the boat; 0 for a lost blade
        self.jam, self.free = self._mechanics.jam, self._mechanics.free
        self.disturbances = scenario.disturbances
        wind, bottom = self.disturbances.wind or Wind(), self.disturbances.depth or Depth()
        self.wind_m_s, self.wind_from_rad, self.turbulence = wind.speed_m_s, radians(wind.from_deg), wind.turbulence
        self.start_depth_m, self.bottom_slope = bottom.start_m, bottom.slope
        self.ships = traffic.ships_of(scenario.disturbances.vessels, scenario.speed_m_s, seed)
        self._hull = Hull(scenario, model, seed)
        self._start_utc_s = start_utc_s
        self._goals = list(reversed(goals))
        self._goal_rad: float | None = None
        self._last_row = math.floor(end_s * ROWS_PER_SECOND + 1e-9) if math.isfinite(end_s) else None
        self._step = 0
        self._now_s = 0.0
        self._offset_s = 0.0
        self._record()

    @property
    def now_s(self) -> float:
        """Return the present time of the world."""
        return self._now_s

    def advance_to(self, t_s: float) -> None:
        """Advance to t_s; an earlier time changes nothing."""
        if not t_s > self._now_s:
            return
        while (next_s := (self._step + 1) / STEPS_PER_SECOND) <= t_s:
            self._mechanics.advance(next_s)
            self._hull.step(self.rudder_effect * self.rudder_rad())
            self._step += 1
            self._now_s, self._offset_s = next_s, 0.0
            if self._step % STEPS_PER_ROW == 0:
                self._record()
        self._mechanics.advance(t_s)
        self._now_s = t_s
        self._offset_s = min(max(t_s - self._step / STEPS_PER_SECOND, 0.0), GRID_S)

    def add_heading(self, angle_rad: float) -> None:
        """Change the heading at once, as a breaking wave does."""
        self._hull.add_heading(angle_rad)

    def rudder_rad(self) -> float:
        """Return the true angle of the rudder now."""
        return self._mounting.rudder_rad(self._mechanics.angle_rad())

    def heading_low_rad(self) -> float:
        """Return the hull's heading without wave yaw, unwrapped."""
        return self._hull.heading_low_rad(self._offset_s)

    def goal_rad(self) -> float | None:
        """Return the present goal, within half a turn of the heading at which it was set."""
        return self._goal_rad

    # Attitude: the quantities that the compass in its mounting measures.

    def heading_rad(self) -> float:
        """Return the compass output now, without its noise and resolution."""
        return self._hull.compass_heading_rad(self._offset_s) - self._mounting.compass_offset_rad

    def yaw_rate_rad_s(self) -> float:
        """Return the yaw rate now, including wave yaw."""
        return self._hull.yaw_rate_rad_s(self._offset_s)

    # Whereabouts: the quantities that the GNSS receiver measures.

    def latitude_deg(self) -> float:
        """Return the geodetic latitude."""
        return START_LATITUDE_DEG + self._hull.position_in_waves_m(self._offset_s)[0] / METRES_PER_DEGREE

    def longitude_deg(self) -> float:
        """Return the geodetic longitude."""
        metres = METRES_PER_DEGREE * math.cos(radians(START_LATITUDE_DEG))
        return START_LONGITUDE_DEG + self._hull.position_in_waves_m(self._offset_s)[1] / metres

    def speed_over_ground_m_s(self) -> float:
        """Return the speed over ground."""
        return math.hypot(*self._hull.velocity_in_waves_m_s(self._offset_s))

    def course_over_ground_rad(self) -> float:
        """Return the course over ground from true north, in [0, 2 pi)."""
        north_m_s, east_m_s = self._hull.velocity_in_waves_m_s(self._offset_s)
        return wrap_two_pi(math.atan2(east_m_s, north_m_s))

    def utc_s(self) -> float:
        """Return the seconds since 1970-01-01 UTC."""
        return self._start_utc_s + self._now_s

    # Weather and bottom, which wind sensor and echo sounder measure.

    def bow_rad(self) -> float:
        """Return the direction of the bow from true north, with wave yaw, unwrapped."""
        return self._hull.heading_rad(self._offset_s)

    def velocity_m_s(self) -> tuple[float, float]:
        """Return the velocity of the boat over the ground, north and east, with the motion in waves."""
        return self._hull.velocity_in_waves_m_s(self._offset_s)

    def air_velocity_m_s(self) -> tuple[float, float]:
        """Return the mean velocity of the air over the ground, north and east."""
        return -self.wind_m_s * math.cos(self.wind_from_rad), -self.wind_m_s * math.sin(self.wind_from_rad)

    def water_depth_m(self) -> float:
        """Return the water depth below the surface at the boat."""
        return self.start_depth_m - self.bottom_slope * self._hull.position_m(self._offset_s)[0]

    def _record(self) -> None:
        row = self._step // STEPS_PER_ROW
        if self._last_row is not None and row > self._last_row:
            return
        time_s = row / ROWS_PER_SECOND
        heading_low_rad = self._hull.heading_low_rad(0.0)
        while self._goals and self._goals[-1].t_s <= time_s:
            goal_rad = self._goals.pop().heading_rad
            self._goal_rad = goal_rad + TWO_PI * round((heading_low_rad - goal_rad) / TWO_PI)
        self.truth.append(
            (
                time_s,
                heading_low_rad,
                self._hull.heading_rad(0.0),
                self._hull.yaw_rate_low_rad_s(0.0),
                self.rudder_rad(),
                self._mounting.rudder_rad(self.shaft.target_rad),
                self._goal_rad,
                *self._hull.position_m(0.0),
                self._hull.speed_m_s,
                *((self._hull.float_heading_rad(0.0),) if self._has_two_bodies else ()),
            )
        )
