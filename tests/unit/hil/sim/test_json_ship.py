"""The JSON interface of the ship, with packets as in ArduPilot's documentation."""

import json
import math
import struct

import pytest

from hil.ship.scenarios import find_scenario
from hil.sim.json_ship import AWAY_S, MAGIC, ActiveAutopilot, JsonShip, PacketError, read_packet
from hil.sim.world import World

TRAVEL_RAD = math.radians(30.0)


def packet(frame, steering_us=1500, rate_hz=50, magic=MAGIC, servo=1):
    pulses = [1500] * 16
    pulses[servo - 1] = steering_us
    return struct.pack("<HHI16H", magic, rate_hz, frame, *pulses)


@pytest.fixture
def ship():
    return JsonShip(World(find_scenario("calm"), 1), servo=1, travel_rad=TRAVEL_RAD)


def state_after(ship, *args, **options):
    line = ship.answer(read_packet(packet(*args, **options)))
    assert line.endswith(b"\n")
    return json.loads(line)


def test_frames_advance_the_time(ship):
    assert state_after(ship, 1)["timestamp"] == pytest.approx(0.02)
    assert state_after(ship, 2)["timestamp"] == pytest.approx(0.04)
    assert state_after(ship, 2)["timestamp"] == pytest.approx(0.04)  # the same packet again
    assert state_after(ship, 5)["timestamp"] == pytest.approx(0.10)  # two were lost
    assert state_after(ship, 1)["timestamp"] == pytest.approx(0.12)  # the autopilot has restarted
    assert state_after(ship, 2, rate_hz=400)["timestamp"] == pytest.approx(0.1225)


def test_a_late_packet_has_no_effect(ship):
    for frame in range(1, 100):
        state = state_after(ship, frame)
    assert state_after(ship, 98, 1900) == state
    assert state_after(ship, 2, 1900) == state
    assert state_after(ship, 100)["timestamp"] == pytest.approx(2.0)
    assert ship._world.rudder_rad() == pytest.approx(0.0, abs=1e-6)


def test_one_autopilot_at_a_time():
    active, first, second = ActiveAutopilot(), ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert active.receive(first, 100.0)
    with pytest.raises(PacketError, match=r"127\.0\.0\.1:2 is ignored while"):
        active.receive(second, 100.1)
    assert not active.receive(first, 101.0)
    with pytest.raises(PacketError):
        active.receive(second, 101.0 + 0.9 * AWAY_S)
    assert active.receive(second, 101.0 + AWAY_S)
    assert active.address == second
    with pytest.raises(PacketError):
        active.receive(first, 101.1 + AWAY_S)


def test_a_pulse_to_starboard_turns_the_boat_to_starboard(ship):
    for frame in range(1, 1000):
        state = state_after(ship, frame, 1900)
    assert state["attitude"][2] > 0.3
    assert state["imu"]["gyro"][2] > 0.0
    east = state["velocity"][1]
    assert east > 0.0
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    turned_rad = state["attitude"][2]
    # The acceleration in a turn is speed times yaw rate, to starboard here.
    assert state["imu"]["accel_body"][1] == pytest.approx(0.4 * state["imu"]["gyro"][2], rel=0.1)
    for frame in range(1000, 1100):
        state = state_after(ship, frame, 0)  # no pulse: the servo keeps its angle
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    assert state["attitude"][2] > turned_rad


def test_packets_with_32_outputs(ship):
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
        (packet(1, rate_hz=0), "frame rate 0 Hz"),
    ],
)
def test_invalid_packets(data, complaint):
    with pytest.raises(PacketError, match=complaint):
        read_packet(data)
