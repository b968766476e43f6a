"""Results of a tick: frozen records for the log, the link and the controller. Conventions as in records.py."""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.mode_table import Mode
from firmware_py.common.records import (
    CalibrationState,
    DepthSample,
    Event,
    PositionSample,
    RudderCommand,
    RudderFeedback,
)
from firmware_py.common.vessels import Traffic


class MissionState(IntEnum):
    """State of the mission, numbered as MAVLink's MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class Home(msgspec.Struct, frozen=True):
    """Destination of RTL and origin of local coordinates."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float  # above mean sea level


class MissionReport(msgspec.Struct, frozen=True):
    """Progress of the mission; `index` counts from 0, None without a current item.

    The operator counts from `first_item_number` (plan.first_item_number). `reached_items` are those reached in this
    tick; `identities` are the checksums of mission, fence and rally points (plan.Plan.identity).
    """

    state: MissionState = MissionState.NO_MISSION
    index: int | None = None
    count: int = 0
    reached_items: tuple[int, ...] = ()
    identities: tuple[int, int, int] = (0, 0, 0)
    first_item_number: int = 0


class Water(msgspec.Struct, frozen=True):
    """Speed through the water, current and leeway, with standard deviations.

    `leeway_rad` is positive to starboard of the heading. `current_sd_m_s` belongs to the less certain direction.
    `too_strong`: the current exceeds the speed of the boat, so that it cannot stay at a position.
    """

    speed_m_s: float
    speed_sd_m_s: float
    current_north_m_s: float
    current_east_m_s: float
    current_sd_m_s: float
    leeway_rad: float = 0.0
    leeway_sd_rad: float = 0.0
    too_strong: bool = False


class Activity(IntEnum):
    """Present activity of guidance."""

    NOTHING = 0  # rudder by hand or amidships
    HEADING = 1  # a heading or a course
    LINE = 2  # along a line to a position
    STATION = 3  # station keeping in a loiter circle
    CIRCLE = 4  # circling a position


class Navigation(msgspec.Struct, frozen=True):
    """Target of guidance: position, radius around it, and cross-track error, positive to starboard of the line.

    `fence_margin_m` is the distance to a breach of the fence, negative in breach, None while the fence is disabled or
    the margin unknown.
    """

    activity: Activity = Activity.NOTHING
    target_latitude_rad: float | None = None
    target_longitude_rad: float | None = None
    radius_m: float | None = None
    cross_track_m: float | None = None
    arrived: bool = False
    fence_enabled: bool = False
    fence_margin_m: float | None = None


class Estimate(msgspec.Struct, frozen=True):
    """Estimated motion with standard deviations, and the learned noise levels; headings are without wave yaw.

    `source` of the heading: compass A 0, compass B 1, course over ground 2, none 3. `bias_rad` is the rudder bias.
    `wave_sd_rad` is the standard deviation of the wave yaw itself, not of its estimate. `wave_damping` is a
    damping ratio, `yaw_diffusion_rad2_s` the diffusion of the heading, `bias_walk_rad_sqrt_s` the random walk of the
    rudder bias.
    `innovation_square` is the mean square of the innovations, normalised by their variance; `prediction_square` the
    same for predictions over half a minute. Both are 1 for a consistent filter.
    """

    source: int
    heading_rad: float
    heading_sd_rad: float
    yaw_rate_rad_s: float
    yaw_rate_sd_rad_s: float
    bias_rad: float
    bias_sd_rad: float
    wave_period_s: float
    wave_sd_rad: float
    compass_noise_rad: float
    speed_m_s: float
    speed_sd_m_s: float
    current_north_m_s: float
    current_east_m_s: float
    innovation_rad: float
    innovation_sd_rad: float
    innovation_square: float
    wave_yaw_rad: float = 0.0
    wave_damping: float = 0.0
    yaw_diffusion_rad2_s: float = 0.0
    bias_walk_rad_sqrt_s: float = 0.0
    prediction_square: float = 1.0


class Energy(msgspec.Struct, frozen=True):
    """Cost of steering since the start, rudder travel and reversals in about the last hour, and servo power.

    `energy_j` and `power_w` are measured by the servo; `resting`: its torque is released.
    """

    travel_rad: float = 0.0
    reversals: int = 0
    energy_j: float = 0.0
    travel_rad_per_h: float = 0.0
    reversals_per_h: float = 0.0
    power_w: float | None = None
    resting: bool = False


class Flow(msgspec.Struct, frozen=True):
    """Energy in one direction since the start, and the duration of its measurement."""

    energy_j: float = 0.0
    measured_s: float = 0.0


class Power(msgspec.Struct, frozen=True):
    """Battery, panels and loads; None for values that are not measured. Positive currents charge the battery.

    `charge` is the state of charge, 0 to 1.
    """

    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    temperature_c: float | None = None
    solar_w: float | None = None
    load_w: float | None = None
    solar: Flow = Flow()
    load: Flow = Flow()
    charged: Flow = Flow()
    discharged: Flow = Flow()


class Wind(msgspec.Struct, frozen=True):
    """Wind at the boat; None for values that are not known. Equations and averaging times: estimate/wind.py.

    `apparent_m_s` and `apparent_rad` are the last apparent wind, from the bow. `wind_m_s` and `from_rad` are the wind
    over the ground, averaged over 10 s, `north_m_s` and `east_m_s` the velocity of the air. `mean_...`: averages over
    2 min, `sd_m_s` is the standard deviation of the speed in that time, `gust_m_s` the maximum gust of the last 10 min.
    An angle is that from which the wind comes.
    """

    t_s: float
    apparent_m_s: float | None = None
    apparent_rad: float | None = None
    north_m_s: float | None = None
    east_m_s: float | None = None
    wind_m_s: float | None = None
    from_rad: float | None = None
    mean_m_s: float | None = None
    mean_from_rad: float | None = None
    sd_m_s: float | None = None
    gust_m_s: float | None = None


class DeadReckoningPosition(msgspec.Struct, frozen=True):
    """Position and velocity by dead reckoning, and the time since the last fix.

    `sd_m` is the standard deviation along the axis where it is largest.
    """

    latitude_rad: float
    longitude_rad: float
    north_m_s: float
    east_m_s: float
    sd_m: float
    time_since_fix_s: float


class Snapshot(msgspec.Struct, frozen=True):
    """State of the boat after a tick, for the log and the link.

    `heading_rad` and `yaw_rate_rad_s` are measured by the compass; `heading_error_rad` is the goal minus the
    estimated heading of the glider. `rudder_rad` is measured, `rudder_estimate_rad` estimated because it is not
    measured, and `rudder_command_rad` commanded, all in the frame of the rudder. `..._ok`: the values are fresh.
    `distance_m` is None without a position goal.
    """

    t_s: float
    tick: int
    mode: Mode
    armed: bool
    heading_rad: float | None
    heading_ok: bool
    yaw_rate_rad_s: float | None
    roll_rad: float | None
    pitch_rad: float | None
    goal_heading_rad: float | None
    heading_error_rad: float | None
    bearing_rad: float | None
    distance_m: float | None
    rudder_rad: float | None
    rudder_command_rad: float
    rudder_ok: bool
    servo: RudderFeedback | None
    position: PositionSample | None
    position_ok: bool
    faults: int  # bit n is row n of faults.TABLE
    rate_hz: float
    skipped_total: int
    late_s: float
    home: Home | None = None
    mission: MissionReport = MissionReport()
    prearm_refusal: str = ""  # reason why arming is refused; empty if it is allowed
    estimate: Estimate | None = None
    water: Water | None = None
    navigation: Navigation = Navigation()
    energy: Energy | None = None
    gain_reduction: float = 1.0  # divisor of the proportional gain, 1 or more
    power: Power | None = None
    power_saving_level: int = 0  # a member of safety.power_saving.Saving
    traffic: Traffic | None = None  # other vessels, None before the first AIS report
    dead_reckoning: DeadReckoningPosition | None = None  # replaces the position while it is used
    heading_age_s: float | None = None  # age of the last heading used; None before the first
    rudder_estimate_rad: float | None = None
    wind: Wind | None = None  # last wind; None before the first
    wind_ok: bool = False
    depth: DepthSample | None = None  # last water depth; None before the first
    depth_ok: bool = False


class Output(msgspec.Struct, frozen=True):
    """Result of a tick."""

    command: RudderCommand
    snapshot: Snapshot
    events: tuple[Event, ...] = ()


class SwingReport(msgspec.Struct, frozen=True):
    """Progress of a compass swing: NONE, RUNNING while there is no proposal yet, or DONE.

    `percent` of the data that a proposal needs. `minutes`: number of minute values. `sectors`: bit n is set when that
    twelfth of the circle has data. The coefficients are A to E, present and estimated. `sd_rad` is the largest standard
    deviation of the estimated curve, `max_change_rad` the largest difference between both curves. `residual_before_rad`
    and `residual_after_rad` are the rms errors of the minute values with the present and the estimated coefficients.
    """

    state: CalibrationState = CalibrationState.NONE
    percent: int = 0
    minutes: int = 0
    sectors: int = 0
    present_rad: tuple[float, ...] = ()
    estimated_rad: tuple[float, ...] = ()
    sd_rad: float | None = None
    max_change_rad: float | None = None
    residual_before_rad: float | None = None
    residual_after_rad: float | None = None
