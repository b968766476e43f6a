"""The driver of AIS: whose reports it gives, and what a flood costs."""

import itertools
import random

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.common.vessels import VesselIdentity, VesselPosition
from firmware_py.sensors.ais import MAX_PENDING_REPORTS, MAX_REPORTS_PER_TICK, MAX_SENTENCES_HZ, AisOptions, AisReceiver
from hil.devices.ais_frames import position_a, position_b, sentences, static_a, static_b
from support.line import FakeLine


def receiver(**options):
    line = FakeLine()
    return line, AisReceiver(line, AisOptions(**options))


def ship(mmsi, latitude_deg=36.0):
    return sentences(position_a(mmsi, latitude_deg, 121.0, 10.0, 90.0, 92))


def take(line, device, data, now_s=0.0):
    line.inbox += data
    device.receive(now_s)
    return device.poll()


def test_reports_are_stamped_and_positions_come_first():
    line, device = receiver()
    data = sentences(static_a(211000001, "ANNA", "DA1", 70, (90, 10, 8, 8))) + ship(211000001)
    position, identity = take(line, device, data, 5.0)
    assert isinstance(position, VesselPosition)
    assert isinstance(identity, VesselIdentity)
    assert (identity.name, identity.call_sign, identity.dimensions_m) == ("ANNA", "DA1", (90, 10, 8, 8))
    assert position.t_s == identity.t_s == 5.0
    health = device.health(5.0)
    assert (health.role, health.state, health.accepted, health.rejected) == (DeviceRole.AIS, DeviceState.RUNNING, 2, 0)


def test_of_a_vessel_that_waits_the_newest_is_given_and_what_it_is_is_put_together():
    line, device = receiver()
    data = ship(1, 36.0) + b"".join(map(sentences, static_b(1, "BOB", "XY", 37, (4, 5, 1, 1)))) + ship(1, 36.5)
    position, identity = take(line, device, data)
    assert round(position.latitude_rad, 6) == round(36.5 * 3.141592653589793 / 180.0, 6)
    assert (identity.name, identity.call_sign, identity.ship_type) == ("BOB", "XY", 37)


def test_own_transmissions_are_not_vessels_and_give_the_own_mmsi():
    line, device = receiver()
    own = sentences(position_b(235000007, 36.0, 121.0, 0.8, 0.0), own=True)
    assert take(line, device, own) == ()
    assert take(line, device, ship(235000007)) == ()
    assert "another station uses the boat's MMSI 235000007" in device.health(0.0).text
    assert device.health(0.0).rejected == 1
    assert len(take(line, device, ship(235000008))) == 1


def test_the_mmsi_of_the_vehicle_file_is_not_replaced():
    line, device = receiver(own_mmsi=235000007)
    take(line, device, sentences(position_b(235000099, 36.0, 121.0, 0.8, 0.0), own=True))
    assert take(line, device, ship(235000007)) == ()
    assert len(take(line, device, ship(235000099))) == 1


def test_ten_thousand_vessels_cost_a_bounded_piece_of_each_tick():
    """Work is counted, not timed: bytes and sentences of a read, reports of a tick, and what is kept between them."""
    line, device = receiver()
    rng = random.Random(1)
    numbers = rng.sample(range(200_000_000, 775_000_000), 10_000)
    flood = itertools.cycle([ship(number) for number in numbers])
    decoded = reports = sent = 0
    most_reports = most_decoded = 0
    for tick in range(600):
        for _ in range(100):  # 1000 a second, thirteen times what the channels hold
            line.inbox += next(flood)
            sent += 1
        before = device.health(0.1 * tick).accepted
        device.receive(0.1 * tick)
        given = len(device.poll())
        now = device.health(0.1 * tick).accepted - before
        most_decoded, most_reports = max(most_decoded, now), max(most_reports, given)
        decoded, reports = decoded + now, reports + given
        assert len(device._pending) <= MAX_PENDING_REPORTS
    assert most_reports <= MAX_REPORTS_PER_TICK
    assert decoded <= MAX_SENTENCES_HZ * 60.0 + 100
    health = device.health(60.0)
    assert health.rejected > 0
    assert "dropped" in health.text
    # Nothing is lost in silence: what was read is decoded or counted.
    read = sent - len(line.inbox) / len(ship(numbers[0]))
    assert abs(health.accepted + health.rejected - read) <= 2
