"""Conversion of onboard logs to recordings, including logs with invalid numbers or states."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_py.common.records import (
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
    RudderAngleSample,
    RudderFeedback,
    Tick,
)
from firmware_py.log import schema
from firmware_py.log.dataflash import header
from hil.errors import UsageError
from hil.lab.identify.onboard_log import read
from hil.lab.identify.recording import Source

PARAMETERS = '{"parameters":{"RUD_CENTRE_DEG":0.0,"RUD_REVERSE":1.0}}'
DECISION = SimpleNamespace(
    command=SimpleNamespace(shaft_rad=0.0, torque_on=True),
    snapshot=SimpleNamespace(
        mode=0, armed=True, faults=0, rudder_command_rad=0.0, rudder_rad=None, rudder_ok=True, skipped_total=0
    ),
)


def heading(t_s, heading_rad=1.0):
    return schema.HEADING.pack(t_s, HeadingSample(t_s, heading_rad, NorthReference.TRUE))


def shaft(t_s, shaft_rad=0.1):
    return schema.FEEDBACK.pack(t_s, RudderFeedback(t_s, shaft_rad))


def fix(t_s):
    return schema.POSITION.pack(t_s, PositionSample(t_s, FixType.FIX_3D, 0.6, 2.1, speed_over_ground_m_s=0.5))


@pytest.fixture
def read_log(tmp_path):
    """Read a log with a stored state and one tick that contains the messages."""

    def write_and_read(*messages, state=PARAMETERS):
        tick = Tick(0, 0.0, 0.0, 0, 10.0)
        messages_of_tick = [schema.TICK.pack(0.0, tick), schema.CHECKPOINT.pack_text(0.0, tick, state), *messages]
        batch = b"".join([*messages_of_tick, schema.CONTROL.pack(0.0, DECISION)])
        path = tmp_path / "x.BIN"
        path.write_bytes(header(schema.TYPES, 0) + schema.append_end(batch, 0.0, 0))
        return read(path)

    return write_and_read


def messages_at(times, *makers):
    return [maker(float(t_s)) for t_s in times for maker in makers]


def test_log_is_converted_to_columns(read_log):
    recording = read_log(*messages_at(range(30), heading, shaft, fix))
    assert recording.time_s.tolist() == list(range(30))
    assert set(recording.rudder_rad) == {-0.1}
    assert np.allclose(recording.speed_m_s, 0.5)
    assert recording.notes == ("speed over ground used, smoothed over 60 s",)


@pytest.mark.parametrize(
    ("makers", "number"),  # NaN in a shaft angle means not measured and is valid
    [((heading, shaft), math.nan), ((heading, shaft), -math.inf), ((shaft, heading), math.inf)],
)
def test_log_with_an_infinite_number_is_refused(read_log, makers, number):
    invalid, valid = makers
    before, after = messages_at(range(30), *makers), messages_at(range(31, 40), *makers)
    with pytest.raises(UsageError, match=r"x\.BIN: contains a number that is not finite; give a log"):
        read_log(*before, invalid(30.0, number), valid(30.0), *after)


def test_log_without_common_times_of_heading_and_rudder_is_refused(read_log):
    recording = read_log(*messages_at(range(30), heading), *messages_at(range(100, 130), shaft, fix))
    with pytest.raises(UsageError, match="too short, 0 rows"):
        recording.part(Source("x.BIN"))


@pytest.mark.parametrize(
    "state", ["[" * 100_000, PARAMETERS.replace("0.0", "1" + "0" * 400), '{"parameters":[]}', "null", ""]
)
def test_invalid_state_is_ignored(read_log, state):
    recording = read_log(*messages_at(range(30), heading, shaft), state=state)
    assert set(recording.rudder_rad) == {0.1}
    assert "no stored parameters: the shaft angle is used as rudder angle" in recording.notes


def sensor(t_s):
    return schema.RUDDER_ANGLE.pack(t_s, RudderAngleSample(t_s, 0.25))


@pytest.mark.parametrize(("count", "rudder_rad"), [(30, 0.25), (3, -0.1)])
def test_angle_of_a_rudder_angle_sensor_is_used_if_there_are_enough(read_log, count, rudder_rad):
    recording = read_log(*messages_at(range(30), heading, shaft), *messages_at(range(count), sensor))
    assert set(recording.rudder_rad) == {rudder_rad}
    assert ("angles of the rudder angle sensor used" in recording.notes) is (count == 30)
