"""The JSON interface of the ship with packets of ArduPilot."""

import json
import math
import struct

import pytest

from hil.ship.scenarios import find_scenario
from hil.sim.json_ship import INACTIVE_S, MAGIC, ActiveAutopilot, JsonShip, PacketError, read_packet
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
    line = ship.reply(read_packet(packet(*args, **options)))
    assert line.endswith(b"\n")
    return json.loads(line)


def test_each_frame_advances_the_time(ship):
    assert state_after(ship, 1)["timestamp"] == pytest.approx(0.02)
    assert state_after(ship, 2)["timestamp"] == pytest.approx(0.04)
    assert state_after(ship, 2)["timestamp"] == pytest.approx(0.04)  # repeated packet
    assert state_after(ship, 5)["timestamp"] == pytest.approx(0.10)  # two lost packets
    assert state_after(ship, 1)["timestamp"] == pytest.approx(0.12)  # the autopilot has restarted
    assert state_after(ship, 2, rate_hz=400)["timestamp"] == pytest.approx(0.1225)


def test_late_packet_has_no_effect(ship):
    for frame in range(1, 100):
        state = state_after(ship, frame)
    assert state_after(ship, 98, 1900) == state
    assert state_after(ship, 2, 1900) == state
    assert state_after(ship, 100)["timestamp"] == pytest.approx(2.0)
    assert ship._world.rudder_rad() == pytest.approx(0.0, abs=1e-6)


def test_second_autopilot_is_accepted_after_the_first_is_inactive():
    active, first, second = ActiveAutopilot(), ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert active.receive(first, 100.0)
    with pytest.raises(PacketError, match=r"127\.0\.0\.1:2 is ignored while"):
        active.receive(second, 100.1)
    assert not active.receive(first, 101.0)
    with pytest.raises(PacketError):
        active.receive(second, 101.0 + 0.9 * INACTIVE_S)
    assert active.receive(second, 101.0 + INACTIVE_S)
    assert active.address == second
    with pytest.raises(PacketError):
        active.receive(first, 101.1 + INACTIVE_S)


def test_pulse_to_starboard_turns_the_boat_to_starboard(ship):
    for frame in range(1, 1000):
        state = state_after(ship, frame, 1900)
    assert state["attitude"][2] > 0.3
    assert state["imu"]["gyro"][2] > 0.0
    assert state["velocity"][1] > 0.0
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    heading_rad = state["attitude"][2]
    # The acceleration is speed times yaw rate, to starboard.
    assert state["imu"]["accel_body"][1] == pytest.approx(0.4 * state["imu"]["gyro"][2], rel=0.1)
    for frame in range(1000, 1100):
        state = state_after(ship, frame, 0)  # no pulse: the servo keeps its angle
    assert ship._world.rudder_rad() == pytest.approx(TRAVEL_RAD, abs=1e-3)
    assert state["attitude"][2] > heading_rad


def test_packet_with_32_outputs_is_accepted(ship):
    pulses = [1500] * 31 + [1900]
    data = struct.pack("<HHI32H", 29569, 50, 7, *pulses)
    assert read_packet(data).pulses_us == tuple(pulses)
    assert json.loads(ship.reply(read_packet(data)))["timestamp"] == pytest.approx(0.02)
    with pytest.raises(PacketError, match="begins with 18458"):
        read_packet(struct.pack("<HHI32H", MAGIC, 50, 7, *pulses))


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (b"", "0 bytes"),
        (packet(1)[:-1], "39 bytes"),
        (packet(1, magic=29569), "29569"),
        (packet(1, rate_hz=0), "frame rate 0 Hz"),
    ],
)
def test_invalid_packet_is_rejected(data, error):
    with pytest.raises(PacketError, match=error):
        read_packet(data)
