"""Whatever happens to servo and cable, three quiet seconds later the rudder follows again."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceState

TROUBLES = ["ticks", "lose", "power off", "power on", "blink", "unplug", "plug in", "noise", "quiet", "full", "release"]


class Trouble:
    """Applies named troubles to a line and its servo."""

    def __init__(self, fakes, servo, rudder_of):
        self.servo = servo
        self.line = fakes.line(servo)
        self.sail = fakes.sail(rudder_of(self.line))

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
        self.sail.ticks(number, shaft_deg=3.0 * number, torque_on=name != "release")

    def calm(self):
        for name in ("quiet", "plug in"):
            self.apply(name, 1)
        if not self.servo.powered:
            self.apply("power on", 1)
        return self.sail.ticks(30, shaft_deg=-20.0)


STORY = st.lists(st.tuples(st.sampled_from(TROUBLES), st.integers(1, 9)), max_size=12)


@given(STORY)
def test_dynamixel_recovers(fakes, story):
    trouble = Trouble(fakes, fakes.dynamixel(), lambda line: dynamixel_rudder(line, DynamixelOptions()))
    for name, number in story:
        trouble.apply(name, number)
    feedback = trouble.calm()
    expected = 2048 + round(math.radians(-20.0) * 4096 / math.tau)
    assert trouble.servo.goal == trouble.servo.position == expected
    assert trouble.sail.health().state is DeviceState.RUNNING
    assert feedback[-1].torque_on is True
    assert all(torque == 0 for _, _, torque in trouble.servo.eeprom_writes)
    assert len(trouble.servo.eeprom_writes) <= 3  # return delay, its answer lost at most twice


@given(STORY)
def test_volz_recovers(fakes, story):
    trouble = Trouble(fakes, fakes.volz(), lambda line: volz_rudder(line, VolzOptions()))
    for name, number in story:
        trouble.apply(name, number)
    feedback = trouble.calm()
    assert trouble.servo.position == 2048 - 384
    assert trouble.sail.health().state is DeviceState.RUNNING
    assert feedback[-1].shaft_rad == pytest.approx(math.radians(-20.0))
