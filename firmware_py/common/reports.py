"""What a tick tells of the boat: frozen records for the log, the link and those who steer by them.

Conventions as in records.py.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.mode_table import Mode
from firmware_py.common.records import CalibrationState, Event, PositionSample, RudderCommand, RudderFeedback
from firmware_py.common.vessels import Traffic


class MissionState(IntEnum):
    """How far the mission is, numbered as MAVLink's MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class Home(msgspec.Struct, frozen=True):
    """Where the boat returns to, and the origin of local coordinates."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float


class MissionReport(msgspec.Struct, frozen=True):
    """The mission as the operator follows it: `index` counts from 0, None without a current item.

    The operator counts from `first`, the number of the first item (plan.homes). `reached` are the items that were
    reached in this very tick; `identities` are the checksums of mission, fence and rally points (plan.Plan.identity).
    """

    state: MissionState = MissionState.NO_MISSION
    index: int | None = None
    count: int = 0
    reached: tuple[int, ...] = ()
    identities: tuple[int, int, int] = (0, 0, 0)
    first: int = 0


class Water(msgspec.Struct, frozen=True):
    """Speed through the water, the current over the ground and the leeway, with standard deviations.

    The way through the water lies `leeway_rad` to starboard of the heading. `current_sd_m_s` is that of the worse
    known direction. `too_strong`: the current is stronger than the boat, so that it cannot hold a place against it.
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
    """What guidance has the boat do."""

    NOTHING = 0  # no goal of guidance: rudder by hand or amidships
    HEADING = 1  # a heading or a course
    LINE = 2  # along a line to a place
    STATION = 3  # a watch circle around a place
    CIRCLE = 4  # round a place


class Navigation(msgspec.Struct, frozen=True):
    """Where guidance takes the boat: the place, the circle around it and how far off the line the boat is.

    `cross_track_m` is positive to starboard of the line. `fence_margin_m` is the distance to a
    breach of the fence, negative in breach, None while the fence is not heeded or not known.
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
    """Estimated motion with standard deviations, and the learned noise levels; headings are without the wave yaw.

    `source` is what the heading is taken from: compass A 0, compass B 1, course over ground 2, nothing 3.
    `bias_rad` is the rudder angle at which the boat runs straight. `innovation_rad` is the difference of the last
    heading from the expected one, `innovation_square` the mean square of such differences by their variance, and
    `prediction_square` that of predictions over half a minute: 1 for a consistent filter.
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
    """What steering has cost since start, the rudder's travel and reversals in about the last hour, the servo's power.

    `energy_j` and `power_w` are those that the servo tells of; `resting`: its torque is released.
    """

    travel_rad: float = 0.0
    reversals: int = 0
    energy_j: float = 0.0
    travel_rad_per_h: float = 0.0
    reversals_per_h: float = 0.0
    power_w: float | None = None
    resting: bool = False


class Flow(msgspec.Struct, frozen=True):
    """Energy that has flowed one way since start, and for how long of that time it was measured."""

    energy_j: float = 0.0
    measured_s: float = 0.0


class Power(msgspec.Struct, frozen=True):
    """Battery, panels and loads as they are measured, None for what nobody measures, and what has flowed.

    A current into the battery is positive; `charge` is 0 to 1.
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


class DeadReckonedPosition(msgspec.Struct, frozen=True):
    """Where she is reckoned to be for want of fixes, her velocity over ground, how uncertain that is, since the last.

    `sd_m`: standard deviation along the axis where it is largest.
    """

    latitude_rad: float
    longitude_rad: float
    north_m_s: float
    east_m_s: float
    sd_m: float
    lasted_s: float


class Snapshot(msgspec.Struct, frozen=True):
    """The state of the boat after a tick, for the log and the link.

    `heading_rad` and `yaw_rate_rad_s` are those of the body with the compass; `heading_error_rad` counts from the
    estimate's, the glider's, which is steered by. `rudder_rad` is measured, `rudder_command_rad` is commanded, both in
    the frame of the rudder. `heading_ok` and `position_ok` say that the values are fresh.
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
    prearm_refusal: str = ""  # why arming would be refused; empty: it would be accepted
    estimate: Estimate | None = None
    water: Water | None = None
    navigation: Navigation = Navigation()
    energy: Energy | None = None
    gain_reduction: float = 1.0  # by what factor the helm is softer than as delivered
    power: Power | None = None  # of battery and panels, where somebody measures them
    saving: int = 0  # how far she saves power (safety.power_saving.Saving)
    traffic: Traffic | None = None  # other vessels, once one was heard
    dead_reckoned: DeadReckonedPosition | None = None  # in the place of a position, while she is steered by it
    heading_age_s: float | None = None  # of the last heading that was taken in; None while none has come


class Output(msgspec.Struct, frozen=True):
    """What one tick decides."""

    command: RudderCommand
    snapshot: Snapshot
    events: tuple[Event, ...] = ()


class SwingReport(msgspec.Struct, frozen=True):
    """A swing of the compass under way: nothing, RUNNING while there is too little for a proposal, DONE with one.

    `percent`: of what a proposal needs. `sectors`: bit n is set when she has sailed in that twelfth of the circle. The
    coefficients are A to E, in force and as found; `sd_rad` is that of the found curve where it is worst known,
    `off_rad` how far the one in force is from it at most, the residuals by what minutes differ with either (rms).
    """

    state: CalibrationState = CalibrationState.NONE
    percent: int = 0
    minutes: int = 0
    sectors: int = 0
    in_force_rad: tuple[float, ...] = ()
    found_rad: tuple[float, ...] = ()
    sd_rad: float | None = None
    off_rad: float | None = None
    residual_before_rad: float | None = None
    residual_after_rad: float | None = None
