"""MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import ManualRudder
from firmware_py.common.mode_table import Mode

INVALID = 32767


@pytest.mark.parametrize(
    ("y", "r", "expected"),
    [(1000, 0, 1.0), (-1000, 0, -1.0), (250, 900, 0.25), (INVALID, -500, -0.5), (0, 1000, 0.0)],
)
def test_rudder_follows_the_roll_axis_or_the_yaw_axis(rig, y, r, expected):
    assert rig.send(mavlink.MAVLink_manual_control_message(1, 0, y, 0, r, 0)) == []
    assert rig.request_handler.intents == [ManualRudder(expected)]


def test_manual_control_without_a_valid_axis_is_ignored(rig):
    assert rig.send(mavlink.MAVLink_manual_control_message(1, 0, INVALID, 0, INVALID, 0)) == []
    assert rig.request_handler.intents == []


@pytest.mark.parametrize("y", [1001, -1001, -32768, 32766])
def test_stick_out_of_range_is_refused(rig, texts, y):
    (text,) = texts(rig.send(mavlink.MAVLink_manual_control_message(1, 0, y, 0, 0, 0)))
    assert text == "MANUAL_CONTROL: the stick is not within -1000 to 1000"
    assert rig.request_handler.intents == []


def test_stick_of_another_boat_is_ignored(rig):
    assert rig.send(mavlink.MAVLink_manual_control_message(2, 0, 1000, 0, 0, 0)) == []
    assert rig.request_handler.intents == []


def override(pulse_us, target=(1, 1)):
    return mavlink.MAVLink_rc_channels_override_message(*target, pulse_us, 0, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(("pulse_us", "expected"), [(1000, -1.0), (1500, 0.0), (1750, 0.5), (2000, 1.0), (0, None)])
def test_channel_one_is_the_rudder(rig, pulse_us, expected):
    rig.tick(mode=Mode.MANUAL)
    assert rig.send(override(pulse_us)) == []
    assert rig.request_handler.intents == [ManualRudder(expected)]


@pytest.mark.parametrize(("pulse_us", "replies"), [(999, 1), (2001, 1), (65534, 1), (65535, 0)])
def test_other_pulses_change_nothing(rig, texts, pulse_us, replies):
    assert len(texts(rig.send(override(pulse_us)))) == replies
    assert rig.request_handler.intents == []


def test_override_of_another_boat_is_ignored(rig):
    rig.send(override(2000, (2, 1)))
    assert rig.request_handler.intents == []


def test_override_without_effect_is_reported_once(rig, texts):
    rig.tick(mode=Mode.GUIDED, armed=True)
    replies = [text for _ in range(5) for text in texts(rig.send(override(1600)))]
    assert replies == ["RC override ignored in GUIDED: channel 1 is the rudder in MANUAL, the heading in STEERING"]
    rig.tick(mode=Mode.MANUAL, armed=False)
    assert texts(rig.send(override(1600), override(1600))) == ["RC override ignored: disarmed"]
    rig.tick(mode=Mode.MANUAL, armed=True)
    assert texts(rig.send(override(1600), override(0))) == []
    other = mavlink.MAVLink_rc_channels_override_message(1, 1, 65535, 0, 1700, 0, 0, 0, 0, 0)
    assert texts(rig.send(other, other)) == [
        "RC override ignored: channel 1 is the rudder in MANUAL, the heading in STEERING"
    ]


def test_rc_channels_are_reported_while_an_override_is_in_force(rig, of):
    assert of(rig.ticks(20), "RC_CHANNELS") == []
    rig.send(override(1600))
    published = of(rig.ticks(10), "RC_CHANNELS")
    fields = [(one.chancount, one.chan1_raw, one.chan2_raw, one.chan18_raw, one.rssi) for one in published]
    assert set(fields) == {(1, 1600, 65535, 65535, 255)}
    rig.tick(seconds=3.1)
    assert of(rig.ticks(10), "RC_CHANNELS") == []
    rig.send(override(1600), override(0))
    assert of(rig.ticks(10), "RC_CHANNELS") == []
