"""Inputs of the fault conditions, read from the state."""

from __future__ import annotations

from typing import Final

from firmware_py.common.mode_table import MODES, Mode, Need
from firmware_py.common.records import DeviceState
from firmware_py.core import instruments
from firmware_py.core.device_reports import DeviceReports
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.state import Settings, State, fence_enabled
from firmware_py.core.tick_timing import TickTiming
from firmware_py.estimate import sources
from firmware_py.estimate.heading_estimator import HeadingTimeouts
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.sources import SourceState
from firmware_py.faults.row import FaultInput
from firmware_py.guidance import guidance
from firmware_py.modes import ModeState
from firmware_py.safety import power_monitor

FIRST_FIX_S: Final = 180.0  # time of a receiver from a cold start to its first fix


def fault_input(
    settings: Settings, state: State, freshness: Freshness, timeouts: HeadingTimeouts, now_s: float
) -> FaultInput:
    """Return the inputs of the fault conditions; the state is already updated with the inputs of the tick."""
    servo, position, devices = state.rudder.feedback, state.position, state.devices
    compasses, rudder_monitor = state.heading_estimator.tick.sources, state.supervisor.rudder_monitor
    frozen_s = settings.heading_estimator.tick.frozen_s
    is_frozen, is_jumping = find_compass_faults(frozen_s, compasses, timeouts.compass_s, now_s)
    margin_m = guidance.fence_margin_m(state.guidance, state.plans, enabled=fence_enabled(settings, state))
    battery, limits = power_monitor.read_supply(state.power, now_s), settings.battery_limits
    skipped_s, restarted_s, station = state.timing.skipped_t_s, state.rudder.restarted_s, devices.link
    return FaultInput(
        faults=state.fault_latch.active,
        late_age_s=None if skipped_s is None else now_s - skipped_s,
        heading_old=freshness.heading is Age.OLD,
        compass_silent=_is_compass_silent(devices, timeouts, now_s),
        compass_frozen=is_frozen,
        compass_jumping=is_jumping,
        compasses_disagree=sources.compasses_disagree(compasses),
        position_old=freshness.position is Age.OLD
        and (position.fix is not None or _lacks_first_fix(state.modes, state.timing, now_s)),
        position_held_back=_is_held_back(position),
        servo_old=freshness.rudder is Age.OLD,
        servo_error=(servo is not None and servo.hardware_error != 0)
        or (devices.rudder is not None and devices.rudder.state in (DeviceState.FAULTY, DeviceState.FAILED)),
        servo_temperature_c=None if servo is None else servo.temperature_c,
        servo_hot_c=settings.supervisor.hot_c,
        servo_restart_age_s=None if restarted_s is None else now_s - restarted_s,
        rudder_astray=rudder_monitor.deviating,
        rudder_jammed=rudder_monitor.is_jammed,
        rudder_overloaded=rudder_monitor.overloaded,
        steering_lost=state.supervisor.steering_monitor.loss.lost,
        steering_reversed=state.supervisor.steering_monitor.reversal.reversed,
        estimate_inconsistent=state.heading_estimator.tick.check.is_rejected,
        oscillating=state.supervisor.oscillation.oscillating,
        supply_v=None if servo is None else servo.voltage_v,
        supply_low_v=settings.supervisor.low_v,
        battery_charge=battery.charge,
        battery_v=battery.voltage_v,
        save_charge=limits.save_charge,
        save_v=limits.save_v,
        keep_charge=limits.keep_charge,
        keep_v=limits.keep_v,
        power_silent=power_monitor.has_outdated_source(state.power, now_s),
        current_too_strong=state.heading_estimator.water.verdict.too_strong > 0.5,
        mission_unusable=state.modes.armed and state.modes.mode is Mode.AUTO and state.guidance.mission.unusable,
        outside_fence=margin_m is not None and margin_m < 0.0,
        storage=None if devices.storage is None else devices.storage.state,
        clock=None if devices.clock is None else devices.clock.state,
        key=None if devices.key is None else devices.key.state,
        station=None if station is None else station.state,
        station_age_s=None if station is None else now_s - station.t_s,
        station_timeout_s=settings.supervisor.station_s,
        vessel_near=state.traffic.near,
        depth_m=instruments.recent_depth_m(state.instruments, now_s),
        depth_min_m=settings.instruments.depth_min_m,
        wind_m_s=instruments.recent_mean_wind_m_s(state.instruments, now_s),
        wind_max_m_s=settings.instruments.wind_max_m_s,
    )


def _is_compass_silent(devices: DeviceReports, timeouts: HeadingTimeouts, now_s: float) -> bool:
    """Return whether a compass that was received before has exceeded its time-out."""
    return any(
        sample_s is not None and now_s - sample_s > timeout_s
        for sample_s, timeout_s in zip(devices.compass_s, timeouts.compass_s, strict=True)
    )


def _is_held_back(position: PositionState) -> bool:
    """Return whether a newer position than the accepted one is held back."""
    suspect, fix = position.suspect, position.fix
    return suspect is not None and fix is not None and suspect.t_s > fix.t_s


def _lacks_first_fix(modes: ModeState, timing: TickTiming, now_s: float) -> bool:
    """Return whether the mode needs positions and no fix has come within FIRST_FIX_S since the start."""
    started_s = timing.started_s
    if not modes.armed or started_s is None or Need.POSITION not in MODES[modes.mode].needs:
        return False
    return now_s - started_s > FIRST_FIX_S


def find_compass_faults(
    frozen_s: float, state: SourceState, timeouts_s: tuple[float, float], now_s: float
) -> tuple[bool, bool]:
    """Return whether a compass is frozen, and whether another one jumps.

    A compass that differs from the other one from the start, or drifts away slowly, does not jump; they disagree.
    """
    is_frozen, is_jumping, disagree = False, False, sources.compasses_disagree(state)
    for compass, timeout_s in zip(state.compasses, timeouts_s, strict=True):
        if sources.is_frozen(compass, now_s, frozen_s, timeout_s):
            is_frozen = True
        elif (
            sources.is_jumping(compass)
            and sources.is_received(compass, now_s, timeout_s)
            and (compass.agreed or not disagree)
        ):
            is_jumping = True
    return is_frozen, is_jumping
