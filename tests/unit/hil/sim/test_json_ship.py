"""The ship as ArduPilot's simulator sees it, by packets made as its documentation says."""

import json
import math
import struct

import pytest

from hil.ship.scenarios import named
from hil.sim.json_ship import AWAY_S, MAGIC, JsonShip, OneAutopilot, PacketError, read_packet
from hil.sim.world import World

TRAVEL_RAD = math.radians(30.0)


def packet(frame, steering_us=1500, rate_hz=50, magic=MAGIC, servo=1):
    pulses = [1500] * 16
    pulses[servo - 1] = steering_us
    return struct.pack("<HHI16H", magic, rate_hz, frame, *pulses)


@pytest.fixture
def ship():
    return JsonShip(World(named("calm"), 1), servo=1, travel_rad=TRAVEL_RAD)


def told(ship, *args, **options):
    line = ship.answer(read_packet(packet(*args, **options)))
    assert line.endswith(b"\n")
    return json.loads(line)


def test_the_ship_s_time_is_the_frames(ship):
    assert told(ship, 1)["timestamp"] == pytest.approx(0.02)
    assert told(ship, 2)["timestamp"] == pytest.approx(0.04)
    assert told(ship, 2)["timestamp"] == pytest.approx(0.04)  # the same packet again
    assert told(ship, 5)["timestamp"] == pytest.approx(0.10)  # two were lost
    assert told(ship, 1)["timestamp"] == pytest.approx(0.12)  # the autopilot has started anew
    assert told(ship, 2, rate_hz=400)["timestamp"] == pytest.approx(0.1225)


def test_a_packet_that_was_overtaken_moves_neither_her_time_nor_her_rudder(ship):
    for frame in range(1, 100):
        state = told(ship, frame)
    assert told(ship, 98, 1900) == state
    assert told(ship, 2, 1900) == state
    assert told(ship, 100)["timestamp"] == pytest.approx(2.0)
    assert ship._world.rudder_rad() == pytest.approx(0.0, abs=1e-6)


def test_one_autopilot_steers_at_a_time_and_another_once_it_has_gone():
    who, first, second = OneAutopilot(), ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert who.hear(first, 100.0)
    with pytest.raises(PacketError, match=r"127\.0\.0\.1:2, is not answered"):
        who.hear(second, 100.1)
    assert not who.hear(first, 101.0)
    with pytest.raises(PacketError):
        who.hear(second, 101.0 + 0.9 * AWAY_S)
    assert who.hear(second, 101.0 + AWAY_S)
    assert who.address == second
    with pytest.raises(PacketError):
        who.hear(first, 101.1 + AWAY_S)


def test_a_pulse_to_starboard_turns_her_to_starboard(ship):
    for frame in range(1, 1000):
        state = told(ship, frame, 1900)
    assert state["attitude"][2] > 0.3
    assert state["imu"]["gyro"][2] > 0.0
    east = state["velocity"][1]
    assert east > 0.0
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    turned_rad = state["attitude"][2]
    # In a turn to starboard she is accelerated to starboard: speed times rate.
    assert state["imu"]["accel_body"][1] == pytest.approx(0.4 * state["imu"]["gyro"][2], rel=0.1)
    for frame in range(1000, 1100):
        state = told(ship, frame, 0)  # no pulse: the servo stays where it is
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    assert state["attitude"][2] > turned_rad


def test_an_autopilot_of_32_outputs_is_understood(ship):
    """SERVO_32_ENABLE of ArduPilot."""
    pulses = [1500] * 31 + [1900]
    data = struct.pack("<HHI32H", 29569, 50, 7, *pulses)
    assert read_packet(data).pulses_us == tuple(pulses)
    assert json.loads(ship.answer(read_packet(data)))["timestamp"] == pytest.approx(0.02)
    with pytest.raises(PacketError, match="begins with 18458"):
        read_packet(struct.pack("<HHI32H", MAGIC, 50, 7, *pulses))


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"", "0 bytes"),
        (packet(1)[:-1], "39 bytes"),
        (packet(1, magic=29569), "29569"),
        (packet(1, rate_hz=0), "0 frames"),
    ],
)
def test_what_is_no_packet_is_named(data, complaint):
    with pytest.raises(PacketError, match=complaint):
        read_packet(data)
