"""State and settings of the autopilot.

Each module has its own record in `State`, which only it changes, and its own record in `Settings`.
"""

from __future__ import annotations

import functools

import msgspec

from firmware_py.common.absence import or_nan
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind, Plans, first_item_number
from firmware_py.common.reports import Home
from firmware_py.common.sample_timeout import timeout_s
from firmware_py.control.heading_controller import HeadingControllerSettings
from firmware_py.control.law import IDLE, LawState
from firmware_py.core.device_reports import DeviceReports
from firmware_py.core.freshness import Age, Freshness, FreshnessSettings, age_of
from firmware_py.core.instruments import InstrumentLimits, InstrumentState
from firmware_py.core.rudder import RudderSettings, RudderState
from firmware_py.core.tick_timing import TickTiming
from firmware_py.estimate import dead_reckoning, heading_estimator, position
from firmware_py.estimate.heading_estimator import HeadingEstimatorSettings, HeadingEstimatorState, HeadingTimeouts
from firmware_py.estimate.position import PositionSettings, PositionState
from firmware_py.estimate.position_consistency import PositionConsistency
from firmware_py.estimate.sources import Source
from firmware_py.faults.latch import LatchState, arming_refusal
from firmware_py.guidance import avoidance, guidance
from firmware_py.guidance.avoidance import AvoidanceSettings, AvoidanceState
from firmware_py.guidance.guidance import GuidanceSettings, GuidanceState
from firmware_py.guidance.traffic import TrafficSettings, TrafficState
from firmware_py.modes import ModeState, Situation
from firmware_py.safety import power_saving
from firmware_py.safety.energy_meter import EnergyMeterState
from firmware_py.safety.power_monitor import PowerMonitorState
from firmware_py.safety.power_saving import BatteryLimits
from firmware_py.safety.supervisor import SupervisorSettings, SupervisorState
from firmware_py.safety.torque_release import TorqueReleaseSettings, TorqueReleaseState


class Settings(msgspec.Struct, frozen=True):
    """Parameters in SI units, grouped by module."""

    heading_estimator: HeadingEstimatorSettings
    position: PositionSettings
    freshness: FreshnessSettings
    supervisor: SupervisorSettings
    guidance: GuidanceSettings
    controller: HeadingControllerSettings
    rudder: RudderSettings
    torque_release: TorqueReleaseSettings
    battery_limits: BatteryLimits
    fence_enabled: bool
    traffic: TrafficSettings
    aside: AvoidanceSettings
    instruments: InstrumentLimits


@functools.lru_cache(maxsize=4)
def settings_of(parameters: ParameterSet) -> Settings:
    """Return the settings for a set of parameters, from a cache."""
    return Settings(
        heading_estimator=HeadingEstimatorSettings.of(parameters),
        position=PositionSettings.of(parameters),
        freshness=FreshnessSettings.of(parameters),
        supervisor=SupervisorSettings.of(parameters),
        guidance=GuidanceSettings.of(parameters),
        controller=HeadingControllerSettings.of(parameters),
        rudder=RudderSettings.of(parameters),
        torque_release=TorqueReleaseSettings.of(parameters),
        battery_limits=BatteryLimits.of(parameters),
        fence_enabled=bool(parameters["FENCE_ENABLE"]),
        traffic=TrafficSettings.of(parameters),
        aside=AvoidanceSettings.of(parameters),
        instruments=InstrumentLimits.of(parameters),
    )


class State(msgspec.Struct, frozen=True):
    """State of the autopilot between ticks.

    `home` is set by requests, the first fix and the mission. `greeting` is a message that the first tick sends.
    `agreement` is the consistency of positions and velocities, `aside` the avoidance of vessels.
    """

    parameters: ParameterSet = ParameterSet()
    plans: Plans = Plans()
    modes: ModeState = ModeState()
    home: Home | None = None
    greeting: str = ""
    timing: TickTiming = TickTiming()
    devices: DeviceReports = DeviceReports()
    rudder: RudderState = RudderState()
    heading_estimator: HeadingEstimatorState = HeadingEstimatorState()
    position: PositionState = PositionState()
    fault_latch: LatchState = LatchState()
    supervisor: SupervisorState = SupervisorState()
    guidance: GuidanceState = GuidanceState()
    controller: LawState = IDLE
    torque_release: TorqueReleaseState = TorqueReleaseState()
    energy_meter: EnergyMeterState = EnergyMeterState()
    power: PowerMonitorState = PowerMonitorState()
    traffic: TrafficState = TrafficState()
    agreement: PositionConsistency = PositionConsistency()
    aside: AvoidanceState = avoidance.IDLE
    instruments: InstrumentState = InstrumentState()

    @classmethod
    def at_start(cls, parameters: ParameterSet, plans: Plans | None = None) -> State:
        """Return the state before the first tick."""
        return cls(
            parameters=parameters,
            plans=plans or Plans(),
            modes=ModeState.at_start(parameters),
            heading_estimator=HeadingEstimatorState.at_start(parameters),
        )


def parameters_in_force(state: State) -> ParameterSet:
    """Return the parameters in force: the values that are set, except for those that power saving replaces."""
    faults = state.fault_latch.active
    if not faults:
        return state.parameters
    return power_saving.parameters_in_force(state.parameters, power_saving.level_of(faults))


def heading_timeouts_of(settings: Settings, devices: DeviceReports) -> HeadingTimeouts:
    """Return the time-outs of the compasses and of the fixes, by their sample intervals."""
    limits = settings.freshness
    a_interval_s, b_interval_s = devices.compass_interval_s
    return HeadingTimeouts(
        compass_s=(
            timeout_s(or_nan(a_interval_s), limits.heading_timeout_s),
            timeout_s(or_nan(b_interval_s), limits.heading_timeout_s),
        ),
        position_s=timeout_s(or_nan(devices.position_interval_s), limits.position_timeout_s),
    )


def freshness_of(settings: Settings, state: State, timeouts: HeadingTimeouts, now_s: float) -> Freshness:
    """Return the ages of heading, position and servo feedback at now_s."""
    started_s = state.timing.started_s
    rudder_timeout_s = timeout_s(or_nan(state.devices.rudder_interval_s), settings.freshness.rudder_timeout_s)
    heading, fix = state.heading_estimator, state.position.fix
    heading_timeout_s = timeouts.of(Source(heading.tick.sources.in_use))
    return Freshness(
        heading=age_of(heading.heading.sample_t_s, started_s, now_s, heading_timeout_s),
        position=age_of(None if fix is None else fix.t_s, started_s, now_s, timeouts.position_s),
        rudder=age_of(state.rudder.feedback_s, started_s, now_s, rudder_timeout_s),
    )


def situation_of(settings: Settings, state: State, freshness: Freshness) -> Situation:
    """Return the situation in which requests for modes and goals are decided."""
    heading = state.heading_estimator.heading
    margin_m = guidance.fence_margin_m(state.guidance, state.plans, enabled=fence_enabled(settings, state))
    return Situation(
        heading_rad=heading.heading_rad if freshness.heading is Age.FRESH else None,
        water=heading_estimator.water_report(state.heading_estimator),
        position_ok=freshness.position is Age.FRESH,
        dead_reckoning_sd_m=_dead_reckoning_sd_m(settings, state, freshness),
        # Feedback without an angle is sufficient, because some servos report no angle without torque.
        rudder_ok=freshness.rudder is Age.FRESH,
        mission_ok=bool(state.plans.mission.items),
        home_ok=state.home is not None or bool(state.plans.rally.items),
        fence_breached=margin_m is not None and margin_m < 0.0,
        fault=arming_refusal(state.fault_latch.active),
    )


def _dead_reckoning_sd_m(settings: Settings, state: State, freshness: Freshness) -> float | None:
    """Return the standard deviation of dead reckoning [m]; None if dead reckoning is not used."""
    place = state.position
    if freshness.position is not Age.OLD or place.dead_reckoning is None or not state.modes.armed:
        return None
    if not settings.guidance.tasks.dead_reckoning_limit_m > 0.0:
        return None
    return dead_reckoning.standard_deviation_m(place.dead_reckoning, position.time_since_fix_s(place))


def situation_at(state: State, now_s: float) -> Situation:
    """Return the situation between two ticks."""
    settings = settings_of(parameters_in_force(state))
    timeouts = heading_timeouts_of(settings, state.devices)
    return situation_of(settings, state, freshness_of(settings, state, timeouts, now_s))


def first_item(state: State) -> int:
    """Return the number of the first mission item as the ground station counts."""
    return first_item_number(int(state.parameters["LNK_IDENTITY"]), PlanKind.MISSION)


def fence_enabled(settings: Settings, state: State) -> bool:
    """Return whether the fence is enabled, by the last command or, without a command, by the parameter."""
    enabled = state.guidance.fence_enabled
    return settings.fence_enabled if enabled is None else enabled
