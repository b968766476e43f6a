"""Three seconds after any sequence of disturbances of servo and line, the rudder follows again."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceState

DISTURBANCES = [
    "ticks",
    "lose",
    "power off",
    "power on",
    "blink",
    "unplug",
    "plug in",
    "noise",
    "quiet",
    "full",
    "release",
]


class DisturbedRig:
    """Applies named disturbances to a line and its servo."""

    def __init__(self, fakes, servo, rudder_of):
        self.servo = servo
        self.line = fakes.line(servo)
        self.rig = fakes.rig(rudder_of(self.line))

    def apply(self, name, number):
        servo, line = self.servo, self.line
        if name == "lose":
            line.lose_replies = number
        elif name == "power off":
            servo.powered = False
        elif name in ("power on", "blink"):
            servo.powered = True
            if hasattr(servo, "restart"):
                servo.restart()
        elif name == "unplug":
            line.unplug()
        elif name == "plug in" and not line.connected:
            line.plug()
        elif name == "noise":
            line.noise = bytes((0xFF, 0xFF, 0xFD, 0, 1, number, 0, 0x55))[: number + 1]
        elif name == "full":
            line.full = True
        elif name == "quiet":
            line.noise, line.full, line.lose_replies = b"", False, 0
        self.rig.ticks(number, shaft_deg=3.0 * number, torque_on=name != "release")

    def recover(self):
        """End all disturbances and run for 30 ticks; return the feedback."""
        for name in ("quiet", "plug in"):
            self.apply(name, 1)
        if not self.servo.powered:
            self.apply("power on", 1)
        return self.rig.ticks(30, shaft_deg=-20.0)


SEQUENCES = st.lists(st.tuples(st.sampled_from(DISTURBANCES), st.integers(1, 9)), max_size=12)


@given(SEQUENCES)
def test_dynamixel_recovers(fakes, sequence):
    disturbed = DisturbedRig(fakes, fakes.dynamixel(), lambda line: dynamixel_rudder(line, DynamixelOptions()))
    for name, number in sequence:
        disturbed.apply(name, number)
    feedback = disturbed.recover()
    expected = 2048 + round(math.radians(-20.0) * 4096 / math.tau)
    assert disturbed.servo.goal == disturbed.servo.position == expected
    assert disturbed.rig.health().state is DeviceState.RUNNING
    assert feedback[-1].torque_on is True
    assert all(torque == 0 for _, _, torque in disturbed.servo.eeprom_writes)
    assert len(disturbed.servo.eeprom_writes) <= 3  # return delay, with at most two lost replies


@given(SEQUENCES)
def test_volz_recovers(fakes, sequence):
    disturbed = DisturbedRig(fakes, fakes.volz(), lambda line: volz_rudder(line, VolzOptions()))
    for name, number in sequence:
        disturbed.apply(name, number)
    feedback = disturbed.recover()
    assert disturbed.servo.position == 2048 - 384
    assert disturbed.rig.health().state is DeviceState.RUNNING
    assert feedback[-1].shaft_rad == pytest.approx(math.radians(-20.0))


@given(SEQUENCES)
def test_feetech_recovers(fakes, sequence):
    disturbed = DisturbedRig(fakes, fakes.feetech(), lambda line: feetech_rudder(line, FeetechOptions()))
    disturbed.servo.stored[33] = 3  # another operating mode after each power loss
    disturbed.servo.restart()
    for name, number in sequence:
        disturbed.apply(name, number)
    feedback = disturbed.recover()
    assert disturbed.servo.goal == disturbed.servo.position == 2048 - 228
    assert disturbed.rig.health().state is DeviceState.RUNNING
    assert feedback[-1].torque_on is True
    assert feedback[-1].shaft_rad == pytest.approx(-228 * math.tau / 4096)
    assert disturbed.servo.stored[33] == 3
    assert all(address in (33, 40, 41, 42) for address, _, _ in disturbed.servo.writes)
    assert all(torque == 0 for address, _, torque in disturbed.servo.writes if address == 33)
