"""What the autopilot remembers from tick to tick, and what its parameters mean to its parts."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import DeviceHealth, Home, PositionSample, RudderFeedback
from firmware_py.control import heading_controller
from firmware_py.control.rudder_limit import Linkage, RudderLimits
from firmware_py.estimate import heading_estimator, position, water
from firmware_py.estimate import observer as heading
from firmware_py.faults.latch import LatchState
from firmware_py.faults.page import arming_obstacle
from firmware_py.guidance import guidance
from firmware_py.modes import ModeState, Situation
from firmware_py.safety import supervisor


@dataclass(frozen=True, slots=True)
class Settings:
    """The parameters in the units and groups that the parts compute with."""

    helm: heading_controller.HeadingControllerSettings
    lookout: heading_estimator.HeadingEstimatorSettings
    limits: RudderLimits
    linkage: Linkage
    observer: heading.ObserverSettings
    pilotage: guidance.GuidanceSettings
    watch: supervisor.SupervisorSettings
    position_timeout_s: float
    position_jump_s: float
    rudder_timeout_s: float
    hold_s: float
    release_disarmed: bool
    fence_enabled: bool


@functools.lru_cache(maxsize=4)
def settings_of(parameters: ParameterSet) -> Settings:
    """Convert the parameters, once for each set of values."""
    return Settings(
        heading_controller.HeadingControllerSettings.of(parameters),
        heading_estimator.HeadingEstimatorSettings.of(parameters),
        RudderLimits.of(parameters),
        Linkage.of(parameters),
        heading.ObserverSettings.of(parameters),
        guidance.GuidanceSettings.of(parameters),
        supervisor.SupervisorSettings.of(parameters),
        parameters["POS_TIMEOUT_S"],
        parameters["POS_JUMP_S"],
        parameters["RUD_TIMEOUT_S"],
        parameters["CTL_HOLD_S"],
        bool(parameters["RUD_DISARMED"]),
        bool(parameters["FENCE_ENABLE"]),
    )


@dataclass(frozen=True, slots=True)
class State:
    """All that the autopilot remembers from tick to tick."""

    parameters: ParameterSet = ParameterSet()  # noqa: RUF009 - immutable
    modes: ModeState = ModeState()  # noqa: RUF009 - frozen
    started_s: float | None = None
    t_s: float = 0.0
    heading: heading.HeadingState = heading.HeadingState()  # noqa: RUF009 - frozen
    lookout: heading_estimator.HeadingEstimatorState = heading_estimator.HeadingEstimatorState()  # noqa: RUF009 - frozen
    controller: heading_controller.HeadingControllerState = heading_controller.HeadingControllerState()  # noqa: RUF009 - frozen
    current: water.WaterState = water.WaterState()  # noqa: RUF009 - frozen
    place: position.PositionState = position.PositionState()  # noqa: RUF009 - frozen
    nav: guidance.GuidanceState = guidance.GuidanceState()  # noqa: RUF009 - frozen
    monitor: LatchState = LatchState()  # noqa: RUF009 - frozen
    watch: supervisor.SupervisorState = supervisor.SupervisorState()  # noqa: RUF009 - frozen
    position: PositionSample | None = None
    servo: RudderFeedback | None = None
    storage: DeviceHealth | None = None
    rudder_command_rad: float = 0.0
    plans: Plans = Plans()  # noqa: RUF009 - frozen
    home: Home | None = None
    skipped_total: int = 0
    skipped_t_s: float | None = None
    greeting: str = ""  # what the first tick tells beside the mode

    @classmethod
    def at_start(cls, parameters: ParameterSet, plans: Plans | None = None) -> State:
        """The state before the first tick."""
        return cls(
            parameters,
            ModeState.at_start(parameters),
            current=water.WaterState.at_start(parameters),
            plans=plans or Plans(),
        )


def fresh(t_s: float | None, now_s: float, timeout_s: float) -> bool:
    """Whether something of t_s is there and not too old."""
    return t_s is not None and now_s - t_s <= timeout_s


def situation_of(state: State, now_s: float) -> Situation:
    """What a decision at now_s may depend on."""
    settings = settings_of(state.parameters)
    valid = state.heading.fresh(now_s, settings.observer.timeout_s)
    margin_m = guidance.fence_margin_m(state.nav, state.plans, enabled=fence_enabled(settings, state))
    return Situation(
        state.heading.heading_rad if valid else None,
        water.report(state.current),
        state.position is not None and fresh(state.position.t_s, now_s, settings.position_timeout_s),
        # A released servo of some makes gives no angle, but it answers.
        state.servo is not None and fresh(state.servo.t_s, now_s, settings.rudder_timeout_s),
        mission_ok=bool(state.plans.mission.items),
        home_ok=state.home is not None or bool(state.plans.rally.items),
        fence_breached=margin_m is not None and margin_m < 0.0,
        fault=arming_obstacle(state.monitor.active),
    )


def fence_enabled(settings: Settings, state: State) -> bool:
    """Whether the fence is heeded: as was asked last, else as the parameter says."""
    enabled = state.nav.fence_enabled
    return settings.fence_enabled if enabled is None else enabled
