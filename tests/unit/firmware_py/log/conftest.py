"""A fake autopilot with a small state, and functions that log its ticks."""

import math
import types

import msgspec
import pytest

from firmware_py.common import record_codec
from firmware_py.common.angles import wrap_pi
from firmware_py.common.intents import Arm, Request, SetParameter, SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderCommand,
    RudderFeedback,
    Severity,
    Tick,
    WindReference,
    WindSample,
)
from firmware_py.common.reports import Output, Snapshot
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.log.recorder import LogRecorder


class FakeState(msgspec.Struct, frozen=True):
    smoothed_rad: float = 0.0
    goal_rad: float | None = None
    armed: bool = False


def restore(text):
    """Return the state of a checkpoint, and notes on ignored parts."""
    return record_codec.from_text(FakeState, text, 1)


def step(state, inputs):
    """Steer to the goal with a smoothed heading; return the new state and the output."""
    smoothed_rad, goal_rad, armed = state.smoothed_rad, state.goal_rad, state.armed
    for sample in inputs.headings:
        smoothed_rad += 0.3 * wrap_pi(sample.heading_rad - smoothed_rad)
    for request in inputs.requests:
        if isinstance(request.intent, SteerHeading):
            goal_rad = request.intent.heading_rad
        elif isinstance(request.intent, Arm):
            armed = request.intent.armed
    error_rad = 0.0 if goal_rad is None else wrap_pi(goal_rad - smoothed_rad)
    command = RudderCommand(0.7 * math.tanh(error_rad), armed)
    tick = inputs.tick
    snapshot = Snapshot(
        t_s=tick.t_s,
        tick=tick.index,
        mode=Mode.GUIDED if goal_rad is not None else Mode.HOLD,
        armed=armed,
        heading_rad=smoothed_rad,
        heading_ok=True,
        yaw_rate_rad_s=None,
        roll_rad=None,
        pitch_rad=None,
        goal_heading_rad=goal_rad,
        heading_error_rad=error_rad,
        bearing_rad=None,
        distance_m=None,
        rudder_rad=0.01,
        rudder_command_rad=command.shaft_rad,
        rudder_ok=True,
        servo=None,
        position=None,
        position_ok=False,
        faults=0b101,
        rate_hz=tick.rate_hz,
        skipped_total=tick.skipped,
        late_s=tick.late_s,
    )
    events = (Event(Severity.NOTICE, "goal"),) if len(inputs.requests) > 1 else ()
    return FakeState(smoothed_rad, goal_rad, armed), Output(command, snapshot, events)


def make_inputs(index, rate_hz=2.0):
    """Return inputs that contain every kind of record. At up to 2 Hz the recorder encodes each tick at once."""
    t_s = 12.3 + index * 0.1
    requests = {
        1: (
            Request(t_s, Arm(True), 255, 190),
            Request(t_s, SteerHeading(math.radians(60.0), relative=True, turn=-1), 255, 190),
        ),
        3: (Request(t_s, SetParameter("CTL_K1", 12.5), 254, 1),),
    }
    return Inputs(
        tick=Tick(index, t_s, 1e-5 / 3.0, index % 2, rate_hz),
        headings=(
            HeadingSample(t_s - 0.01, 1.0 / (1.0 + index), NorthReference.MAGNETIC, -0.1, roll_rad=0.02),
            HeadingSample(t_s - 0.005, 0.9, NorthReference.TRUE, source=1),
        ),
        positions=(PositionSample(t_s, FixType.FIX_3D, 0.8, -1.2, 3.5, 0.4, 2.0, 9, 0.9, 1.7e9 + index),)
        if index % 2
        else (PositionSample(t_s, FixType.NONE),),
        rudder=(RudderFeedback(t_s, 0.1, 31.0, 12.1, None, 0x20, None), RudderFeedback(t_s, torque_on=False)),
        devices=(DeviceHealth(t_s, DeviceRole.COMPASS, DeviceState.RUNNING, index, 2, "é" * 50),),
        requests=requests.get(index, ()),
        power=(PowerSample(t_s, 1, 12.8, -0.31, 0.8), PowerSample(t_s, 2, solar_w=20.0, load_a=0.3, temperature_c=9.0))
        if index in requests
        else (),
        vessels=(
            VesselPosition(t_s, 211000001, VesselKind.CLASS_B, 0.8, -1.2, 4.1 / 3.0, 2.0, status=index),
            VesselPosition(t_s, 1, VesselKind.MARK, 0.8, -1.2, turn_rad_s=-0.01, heading_rad=1.0, accurate=True),
            VesselIdentity(t_s, 211000001, "ANNA" * index, "D'A\"1", 70, (90, 10, 8, 8)),
        )
        if index in requests
        else (),
        wind=(WindSample(t_s, 8.1 / 3.0, 1.0 + index, WindReference(index)),) if index in requests else (),
        depth=(DepthSample(t_s, 41.0 / 3.0, 0.4), DepthSample(t_s, 5.0)) if index in requests else (),
    )


def run_ticks(recorder, indexes, state=None, *, after_tick=None, rate_hz=2.0):
    """Offer ticks to the recorder; return the final state, and the inputs and output of each tick."""
    state = FakeState() if state is None else state
    ticks = []
    for index in indexes:
        inputs = make_inputs(index, rate_hz)
        new_state, output = step(state, inputs)
        recorder.offer(inputs, output, lambda state=state: record_codec.to_text(state, 1))
        ticks.append((inputs, output))
        state = new_state
        if after_tick is not None:
            after_tick()
    return state, ticks


def make_recorder(directory, **options):
    defaults = {"file_bytes": 1 << 20, "max_total_bytes": 1 << 30, "utc_s": 1.7e9, "software": "Rambler test"}
    return LogRecorder(directory, **({"parameters": ParameterSet(), "background": False} | defaults | options))


def write_log(directory, count=6):
    """Log ticks and return the bytes of the log."""
    recorder = make_recorder(directory)
    run_ticks(recorder, range(count))
    recorder.close()
    return (directory / "00000001.BIN").read_bytes()


@pytest.fixture
def fake():
    """Return the fake autopilot and the functions that log it."""
    return types.SimpleNamespace(
        State=FakeState,
        step=step,
        restore=restore,
        state_from=lambda text: restore(text)[0],
        to_text=lambda state: record_codec.to_text(state, 1),
        make_inputs=make_inputs,
        run_ticks=run_ticks,
        make_recorder=make_recorder,
        write_log=write_log,
    )
