"""Rudder state: last command, servo feedback, rudder angle sensor, and the angle that they give.

The angle is that of the rudder angle sensor while its samples are fresh, otherwise that of the servo. If neither
measures it, it is estimated from the commands (estimate/rudder_slew.py).
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import msgspec

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, Inputs, RudderAngleSample, RudderFeedback, RudderStatus, Severity
from firmware_py.common.sample_timeout import learn_interval_s, timeout_s
from firmware_py.control.rudder_limit import Linkage, RudderLimits
from firmware_py.estimate import rudder_slew
from firmware_py.estimate.rudder_slew import SlewSettings, SlewState

MAX_SHAFT_RAD: Final = 2.0 * math.pi  # larger feedback is invalid
MAX_SENSOR_RAD: Final = 0.5 * math.pi  # larger angles of the rudder angle sensor are ignored


class RudderSource(IntEnum):
    """Source of the rudder angle."""

    NONE = 0  # before the first feedback
    SERVO = 1
    SENSOR = 2
    ESTIMATE = 3


class RudderSettings(msgspec.Struct, frozen=True):
    """Linkage between servo and rudder, limits of angle and rate, and model of a servo without measured angle.

    `hold_s`: time for which the command is constant without a heading. `released_disarmed`: the servo has no torque
    while disarmed. `sensor_timeout_s`: minimum timeout of the rudder angle sensor (common/sample_timeout.py).
    """

    linkage: Linkage
    limits: RudderLimits
    hold_s: float
    released_disarmed: bool
    slew: SlewSettings
    sensor_timeout_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> RudderSettings:
        """Read the settings from the parameters."""
        return cls(
            linkage=Linkage.of(parameters),
            limits=RudderLimits.of(parameters),
            hold_s=parameters["CTL_HOLD_S"],
            released_disarmed=bool(parameters["RUD_DISARMED"]),
            slew=SlewSettings.of(parameters),
            sensor_timeout_s=parameters["RUD_TIMEOUT_S"],
        )


class RudderState(msgspec.Struct, frozen=True):
    """Last rudder command, last servo feedback, number of servo restarts and time of the last one.

    `sensor` is the last sample of the rudder angle sensor, `sensor_interval_s` its learned interval. `slew` is the
    estimate of an angle that is not measured; None while it is measured and before the first feedback.
    """

    command_rad: float = 0.0
    feedback: RudderFeedback | None = None
    restarts: int = 0
    restarted_s: float | None = None
    sensor: RudderAngleSample | None = None
    slew: SlewState | None = None
    source: RudderSource = RudderSource.NONE
    sensor_interval_s: float = 0.0

    @property
    def feedback_s(self) -> float | None:
        """Time of the last feedback; None before the first."""
        return None if self.feedback is None else self.feedback.t_s


def update(settings: RudderSettings, state: RudderState, inputs: Inputs) -> tuple[RudderState, RudderStatus]:
    """Return the state updated with the feedback of a tick, and the rudder status."""
    now_s, previous = inputs.tick.t_s, state
    angles: list[RudderAngleSample] = []
    sensor, interval_s, min_timeout_s = state.sensor, state.sensor_interval_s, settings.sensor_timeout_s
    if inputs.rudder_angles:
        angles = [sample for sample in inputs.rudder_angles if abs(sample.rudder_rad) <= MAX_SENSOR_RAD]
        for sample in angles:
            if sensor is not None:
                interval_s = learn_interval_s(interval_s, sample.t_s - sensor.t_s, min_timeout_s)
            sensor = sample
    if inputs.rudder:
        newest = inputs.rudder[-1]
        restarted_s = now_s if newest.restarts > state.restarts else state.restarted_s
        state = RudderState(
            *(state.command_rad, newest, newest.restarts, restarted_s, sensor, state.slew, state.source, interval_s)
        )
    elif angles:
        state = msgspec.structs.replace(state, sensor=sensor, sensor_interval_s=interval_s)
    is_sensor_fresh = sensor is not None and now_s - sensor.t_s <= timeout_s(interval_s, min_timeout_s)
    measured_rad = sensor.rudder_rad if sensor is not None and is_sensor_fresh else _shaft_angle_rad(settings, state)
    slew = None
    if measured_rad is None and state.feedback is not None:
        slew = _estimate(settings, previous, state.feedback, now_s)
    if measured_rad is not None:
        source = RudderSource.SENSOR if is_sensor_fresh else RudderSource.SERVO
    else:
        source = RudderSource.NONE if slew is None else RudderSource.ESTIMATE
    if slew is not state.slew or source is not state.source:
        state = msgspec.structs.replace(state, slew=slew, source=source)
    is_repeated = is_sensor_fresh and not angles
    return state, _status(state, measured_rad, now_s, is_new=bool(inputs.rudder), is_repeated=is_repeated)


def source_events(previous: RudderState, state: RudderState) -> tuple[Event, ...]:
    """Return the event of another source of the angle; the first one is reported if it is the estimate."""
    is_first = previous.source is RudderSource.NONE
    is_estimate = state.source is RudderSource.ESTIMATE
    if state.source in (previous.source, RudderSource.NONE) or (is_first and not is_estimate):
        return ()
    severity = Severity.WARNING if previous.source is RudderSource.SENSOR else Severity.NOTICE
    if is_estimate:
        return (Event(severity, "Rudder angle: estimated"),)
    is_servo = state.source is RudderSource.SERVO
    text = "Rudder angle: measured by the servo" if is_servo else "Rudder angle: measured by the sensor"
    return (Event(severity, text),)


def _shaft_angle_rad(settings: RudderSettings, state: RudderState) -> float | None:
    """Return the angle that the servo has measured last; None if its last feedback has none."""
    shaft_rad = None if state.feedback is None else state.feedback.shaft_rad
    return settings.linkage.to_rudder(shaft_rad) if shaft_rad is not None and abs(shaft_rad) <= MAX_SHAFT_RAD else None


def _estimate(settings: RudderSettings, previous: RudderState, feedback: RudderFeedback, now_s: float) -> SlewState:
    """Return the estimate at now_s; the first one begins at the last measured angle, otherwise at the command."""
    if previous.slew is not None:
        is_driven = feedback.torque_on is not False
        return rudder_slew.update(settings.slew, previous.slew, previous.command_rad, now_s, is_driven=is_driven)
    last_rad = _shaft_angle_rad(settings, previous)
    sensor = previous.sensor
    if sensor is not None and (last_rad is None or previous.feedback is None or sensor.t_s >= previous.feedback.t_s):
        last_rad = sensor.rudder_rad
    return rudder_slew.begin(previous.command_rad if last_rad is None else last_rad, previous.command_rad, now_s)


def _status(
    state: RudderState, measured_rad: float | None, now_s: float, *, is_new: bool, is_repeated: bool
) -> RudderStatus:
    feedback, slew = state.feedback, state.slew
    estimate_rad = state.command_rad if slew is None else slew.angle_rad
    angle_rad = estimate_rad if measured_rad is None else measured_rad
    if feedback is None:
        is_measured = measured_rad is not None  # by the sensor
        return RudderStatus(now_s, state.command_rad, angle_rad, measured=is_measured, from_sensor=is_measured)
    power_w = None
    if feedback.voltage_v is not None and feedback.current_a is not None:
        power_w = feedback.voltage_v * abs(feedback.current_a)
    return RudderStatus(
        now_s,
        state.command_rad,
        angle_rad,
        measured=measured_rad is not None,
        is_new=is_new,
        feedback_s=feedback.t_s,
        torque_on=feedback.torque_on,
        current_a=feedback.current_a,
        power_w=power_w if power_w is not None and math.isfinite(power_w) else None,
        is_repeated=is_repeated,
        estimated=slew is not None and feedback.torque_on is not False,
        from_sensor=state.source is RudderSource.SENSOR,
    )
