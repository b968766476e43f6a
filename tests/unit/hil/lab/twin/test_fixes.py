"""Fixes of the compiled plant equal those that the firmware decodes from the emulated receiver, to the last bit."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.sensors.nmea_fields import latitude_field, longitude_field
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions
from hil.devices.nmea_text import format_coordinate
from hil.lab.twin import devices
from hil.lab.twin.sea import sea_of as draw_sea
from hil.ship.scenarios import parse_scenario
from hil.sim.device_factory import make_emulators
from hil.sim.vehicle_file import standard_vehicle
from hil.sim.world import World
from support import voyage
from support.line import FakeLine

pytestmark = pytest.mark.timeout(600)  # the plant is compiled first

SECONDS = 120.0
# Times and angles [rad].
RUDDER = [(20.0 * turn, (-1) ** turn * 32 * (turn % 7) / devices.COUNTS_PER_RADIAN) for turn in range(6)]


def decode_fixes(scenario, seed):
    """Yield the samples that the firmware decodes from the receiver in the harness's world."""
    world = World(scenario, seed, end_s=0.0)
    receiver, line = make_emulators(world, standard_vehicle(), seed)["position"], FakeLine()
    world.shaft.set_torque(on=True)
    driver, orders = NmeaPosition(line, NmeaPositionOptions()), RUDDER.copy()
    while (now_s := min(receiver.next_output_s(), orders[0][0] if orders else math.inf)) <= SECONDS:
        world.advance_to(now_s)
        if orders and now_s == orders[0][0]:
            world.shaft.set_target(orders.pop(0)[1])
        line.inbox += receiver.take_output(now_s)
        driver.receive(now_s)
        yield from driver.poll()


SEAS = ("sea", "coast", "mission", "ocean-1", "ocean-4", "tank+orbital=0.2", "sea+receiver", "sea+receiver=0.1:0.2")


@pytest.mark.parametrize("text", SEAS)
def test_fixes_equal_those_decoded_by_the_firmware(text):
    scenario = parse_scenario(text)
    expected = [voyage.row_of(sample) for sample in decode_fixes(scenario, 3)]
    fixes = voyage.fixes(draw_sea(scenario, 3, SECONDS), RUDDER, SECONDS)
    assert len(expected) >= SECONDS - 3
    assert np.array_equal(fixes[: len(expected)], expected, equal_nan=True)
    assert len(np.unique(fixes[:, devices.LATITUDE_RAD])) > 0.5 * len(expected)


@given(st.floats(-90.0, 90.0))
@example(36.0)
@example(36.99999999)
@example(0.013)  # minutes / 60 differs from minutes * (1 / 60)
def test_decoded_coordinate_equals_the_printed_one_decoded_by_the_firmware(angle_deg):
    for letters, digits, read in (("NS", 2, latitude_field), ("EW", 3, longitude_field)):
        fields = format_coordinate(angle_deg, degree_digits=digits, letters=tuple(letters)).split(",")
        assert devices.decoded_coordinate(angle_deg) == radians(read(0)(fields))
