"""AIS driver: reports, own transmissions, and limits of the work per tick."""

import itertools
import math
import random

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.common.vessels import VesselIdentity, VesselPosition
from firmware_py.sensors.ais import AisOptions, AisReceiver
from hil.devices.ais_frames import position_a, position_b, sentences, static_a, static_b

MAX_PENDING_REPORTS = 256
MAX_REPORTS_PER_TICK = 40
MAX_SENTENCES_HZ = 80.0


@pytest.fixture
def receiver(line):
    return AisReceiver(line, AisOptions())


def ship(mmsi, latitude_deg=36.0):
    return sentences(position_a(mmsi, latitude_deg, 121.0, 10.0, 90.0, 92))


def own_position(mmsi):
    return sentences(position_b(mmsi, 36.0, 121.0, 0.8, 0.0), own=True)


def test_reports_have_the_arrival_time_and_positions_come_first(deliver, receiver):
    data = sentences(static_a(211000001, "ANNA", "DA1", 70, (90, 10, 8, 8))) + ship(211000001)
    position, identity = deliver(receiver, data, now_s=5.0)
    assert isinstance(position, VesselPosition)
    assert isinstance(identity, VesselIdentity)
    assert (identity.name, identity.call_sign, identity.dimensions_m) == ("ANNA", "DA1", (90, 10, 8, 8))
    assert position.t_s == identity.t_s == 5.0
    health = receiver.health(5.0)
    assert (health.role, health.state, health.accepted, health.rejected) == (DeviceRole.AIS, DeviceState.RUNNING, 2, 0)


def test_pending_reports_keep_the_newest_position_and_merge_identities(deliver, receiver):
    identities = map(sentences, static_b(1, "BOB", "XY", 37, (4, 5, 1, 1)))
    position, identity = deliver(receiver, ship(1, 36.0), *identities, ship(1, 36.5))
    assert position.latitude_rad == pytest.approx(math.radians(36.5), abs=1e-6)
    assert (identity.name, identity.call_sign, identity.ship_type) == ("BOB", "XY", 37)


def test_own_transmissions_are_not_reported_and_give_the_own_mmsi(deliver, receiver):
    assert receiver.fileno() == -1
    assert deliver(receiver, own_position(235000007)) == ()
    assert (receiver.health(1.0).state, receiver.health(1.0).accepted) == (DeviceState.RUNNING, 1)
    assert deliver(receiver, ship(235000007)) == ()
    assert "another station uses the boat's MMSI 235000007" in receiver.health(0.0).text
    assert receiver.health(0.0).rejected == 1
    assert len(deliver(receiver, ship(235000008))) == 1


def test_mmsi_of_the_vehicle_file_is_not_replaced(line, deliver):
    receiver = AisReceiver(line, AisOptions(own_mmsi=235000007))
    deliver(receiver, own_position(235000099))
    assert deliver(receiver, ship(235000007)) == ()
    assert len(deliver(receiver, ship(235000099))) == 1


def test_flood_of_ten_thousand_vessels_has_bounded_work_and_memory(line, deliver, receiver):
    """Counts work instead of time: decoded sentences, reports per tick, and pending reports."""
    numbers = random.Random(1).sample(range(200_000_000, 775_000_000), 10_000)
    flood = itertools.cycle([ship(number) for number in numbers])
    for tick in range(600):
        # 1000 sentences a second, thirteen times the capacity of the channels.
        reports = deliver(receiver, *itertools.islice(flood, 100), now_s=0.1 * tick)
        assert len(reports) <= 40
        assert len(receiver._queue._pending) <= 256
    health = receiver.health(60.0)
    assert health.accepted <= MAX_SENTENCES_HZ * 60.0 + 100
    assert health.rejected > 0
    assert "dropped" in health.text
    # Each sentence that was read is decoded or counted.
    read = 600 * 100 - len(line.inbox) / len(ship(numbers[0]))
    assert abs(health.accepted + health.rejected - read) <= 2


def test_a_hundred_sentences_are_decoded_at_once_and_then_eighty_a_second(line, receiver):
    reports = [ship(200_000_000 + number) for number in range(300)]

    def accepted_after(count, now_s):
        line.inbox += b"".join(reports[:count])
        while line.inbox:
            receiver.receive(now_s)
            while receiver.poll():
                pass
        return receiver.health(now_s).accepted

    assert accepted_after(120, 10.0) == 100
    assert accepted_after(60, 10.5) == 140
    assert receiver.health(10.5).rejected == 40
    assert accepted_after(150, 60.0) == 240


def test_reopened_port_discards_incomplete_sentences_and_messages(line, deliver, receiver):
    first, second = sentences(static_a(211000001, "ANNA", "DA1", 70, (90, 10, 8, 8))).splitlines(keepends=True)
    assert deliver(receiver, first, ship(211000002)[:20]) == ()
    line.plug()
    assert deliver(receiver, ship(211000002)[20:], second, now_s=1.1) == ()
    assert receiver.health(1.1).text == "earlier parts of the message are missing"


def test_vessels_beyond_256_between_two_polls_are_dropped_and_counted(line, receiver):
    for number in range(258):
        line.inbox += ship(200_000_000 + number)
        receiver.receive(float(number))
    health = receiver.health(257.0)
    assert (health.accepted, health.rejected, health.text) == (258, 2, "too many vessels, some dropped")


def test_message_of_an_unused_type_is_ignored(deliver, receiver, nmea):
    assert deliver(receiver, nmea("AIVDM,1,1,,A,0000000,0").replace(b"$", b"!")) == ()
    assert (receiver.health(1.0).accepted, receiver.health(1.0).rejected) == (0, 0)


def test_other_data_are_not_understood(deliver, receiver):
    deliver(receiver, b"\x80\xfe")
    assert receiver.health(1.0).text == "data not understood: wrong baud rate?"
    receiver.receive(4.0)
    assert receiver.health(4.0).text == ""


@pytest.mark.parametrize("own_mmsi", [-1, 1_000_000_000])
def test_own_mmsi_out_of_range_is_refused(own_mmsi):
    assert AisOptions(own_mmsi=999_999_999).own_mmsi == 999_999_999
    with pytest.raises(ValueError, match="own_mmsi"):
        AisOptions(own_mmsi=own_mmsi)


@pytest.mark.parametrize(("now_s", "state"), [(600.9, DeviceState.RUNNING), (601.1, DeviceState.SILENT)])
def test_receiver_is_silent_after_ten_minutes(deliver, receiver, now_s, state):
    deliver(receiver, ship(211000001), now_s=1.0)
    assert receiver.health(now_s).state is state
