"""Signatures, compared with pymavlink, and the timestamps that protect against replay."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.records import Stored
from firmware_py.link.signing import NO_VAULT, KeyState, LinkSealer, Signing, from_text, timestamp_of
from firmware_py.link.wire.frames import Codec

UNITS_HZ = 100_000
MAX_NEW_STREAM_LAG = 60 * UNITS_HZ
MAX_STREAMS = 64
MAX_TIMESTAMP = 2_522_880_000 * UNITS_HZ
SIGNATURE_BYTES = 13
STORED_LEAD = 15 * UNITS_HZ

KEY = bytes(range(1, 33))
OTHER_KEY = bytes(32 * [7])
UTC_S = 1.7e9
NOW = 27_992_960_000_000  # at UTC_S: 10 us since 2015


class Boat:
    """Signing with a simulated clock and disk."""

    def __init__(self, content=b"", key=KEY, damage=""):
        self.utc_s = UTC_S
        self.saved = [content]
        self.both = []  # of each saved content: whether both slots had to be written
        self.signing = Signing(lambda: self.utc_s, self.save)
        assert self.signing.restore(Stored(content, damage)) is not KeyState.LOST
        if not content and key:
            assert self.signing.set_key(key, 0)

    def save(self, content, *, both_slots=False):
        self.saved.append(content)
        self.both.append(both_slots)

    def restarted(self, damage=""):
        return Boat(self.saved[-1], damage=damage)


class Station:
    """A signing sender of pymavlink."""

    def __init__(self, key=KEY, timestamp=NOW, link=3, system=255, component=190):
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.signing.secret_key = key
        self.mav.signing.link_id = link
        self.mav.signing.timestamp = timestamp
        self.mav.signing.sign_outgoing = True

    def ping(self, at=None):
        if at is not None:
            self.mav.signing.timestamp = at
        return mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(self.mav)


@pytest.mark.parametrize(
    ("utc_s", "timestamp"),
    [
        (1_420_070_399.0, 0),
        (1_420_070_400.0, 0),  # 2015
        (1_420_070_401.0, 100_000),
        (UTC_S, NOW),
        (3_627_590_400.0, 220_752_000_000_000),  # 70 years of 365 days later
        (3_627_590_400.1, 0),
    ],
)
def test_timestamp_counts_10_us_since_2015_for_70_years(utc_s, timestamp):
    assert timestamp_of(utc_s) == timestamp


def test_any_changed_bit_invalidates_the_signature():
    frame = Station().ping()
    for bit in range(len(frame) * 8):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        assert not Boat().signing.verify(bytes(broken))


def test_forged_future_timestamp_is_ignored():
    boat, station, forger = Boat(), Station(), Station(OTHER_KEY)
    assert boat.signing.verify(station.ping())
    assert not boat.signing.verify(forger.ping(at=2**48 - 1))
    assert not boat.signing.verify(forger.ping(at=MAX_TIMESTAMP))
    assert boat.signing.verify(station.ping())
    # It affects neither a new stream nor the timestamps of the boat.
    assert boat.signing.verify(Station(link=9).ping())
    sealed = LinkSealer(boat.signing, 0).seal(Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0)), 0)
    assert int.from_bytes(sealed[-12:-6], "little") < NOW + UNITS_HZ


def test_replayed_and_older_frames_are_refused():
    boat, station = Boat(), Station()
    first, second, third = (station.ping() for _ in range(3))
    assert boat.signing.verify(second)
    assert not boat.signing.verify(second)
    assert not boat.signing.verify(first)
    assert boat.signing.late_frames == 2
    assert boat.signing.verify(third)
    assert boat.signing.late_frames == 2


def test_streams_differ_by_system_component_and_link():
    boat = Boat()
    kinds = [{}, {"system": 254}, {"component": 1}, {"link": 4}]
    for kind in kinds:
        assert boat.signing.verify(Station(timestamp=NOW + 5, **kind).ping())
    for kind in kinds:
        assert not boat.signing.verify(Station(timestamp=NOW + 5, **kind).ping())


@pytest.mark.parametrize(
    ("behind", "received"),
    [(0, True), (MAX_NEW_STREAM_LAG, True), (MAX_NEW_STREAM_LAG + 1, False), (-(10**9), True), (NOW, False)],
)
def test_new_stream_may_be_one_minute_late(behind, received):
    boat = Boat()
    assert boat.signing.verify(Station().ping(at=NOW - behind)) is received
    assert boat.signing.late_frames == (not received)


def test_timestamp_beyond_the_maximum_is_refused():
    boat = Boat()
    assert not boat.signing.verify(Station().ping(at=MAX_TIMESTAMP + 1))
    assert boat.signing.verify(Station().ping())


def test_own_timestamps_increase_from_the_newest():
    boat = Boat()
    sealer = LinkSealer(boat.signing, 1)
    packed = Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0))

    def stamped():
        return int.from_bytes(sealer.seal(packed, 0)[-12:-6], "little")

    assert [stamped(), stamped()] == [NOW, NOW + 1]
    boat.utc_s += 1.0
    assert stamped() == NOW + UNITS_HZ
    boat.utc_s -= 1000.0  # the clock was set back
    assert stamped() == NOW + UNITS_HZ + 1
    assert boat.signing.verify(Station().ping(at=NOW + 10**8))  # a station whose clock is ahead
    assert stamped() == NOW + 10**8 + 1
    boat.utc_s = 0.0
    assert boat.restarted().signing.has_key
    again = LinkSealer(boat.restarted().signing, 1)
    assert int.from_bytes(again.seal(packed, 0)[-12:-6], "little") > NOW + 10**8 + 1


@pytest.mark.parametrize("utc_s", [4.3e9, 9.2e9, 1e18, 1e300, float("inf"), float("nan"), -1e18])
def test_implausible_clock_is_not_used_for_timestamps(utc_s):
    boat, peer = Boat(), Station()
    assert boat.signing.verify(peer.ping())
    boat.utc_s = utc_s
    sealer = LinkSealer(boat.signing, 1)
    frame = sealer.seal(Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0)), 0)
    assert int.from_bytes(frame[-12:-6], "little") == NOW + 1
    # No other peer is locked out.
    assert boat.signing.verify(Station(link=4).ping())
    assert boat.restarted().signing.verify(Station(link=5).ping(at=NOW + STORED_LEAD))


def test_replay_is_refused_after_a_sudden_restart():
    boat, station = Boat(), Station()
    frames = [station.ping(at=NOW + second * UNITS_HZ) for second in range(120)]
    for frame in frames:
        assert boat.signing.verify(frame)
        boat.utc_s += 1.0
    again = boat.restarted()
    again.utc_s = boat.utc_s
    assert not any(again.signing.verify(frame) for frame in frames)
    assert again.signing.verify(station.ping(at=NOW + 119 * UNITS_HZ + STORED_LEAD + 1))
    assert again.signing.verify(Station(link=8).ping(at=NOW + 119 * UNITS_HZ))


def test_peer_that_receives_a_heartbeat_is_accepted_after_a_sudden_restart():
    """A peer has at least the newest received timestamp; the boat starts ahead of all received ones."""
    boat, station = Boat(), Station()
    assert boat.signing.verify(station.ping())
    again = boat.restarted()
    assert not again.signing.verify(station.ping())
    packed = Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    station.mav.decode(bytearray(LinkSealer(again.signing, 0).seal(packed, 0)))
    assert again.signing.verify(station.ping())


def test_peer_is_accepted_at_once_after_an_orderly_end():
    boat, station = Boat(), Station()
    frame = station.ping()
    assert boat.signing.verify(frame)
    boat.signing.store_exactly()
    again = boat.restarted()
    assert not again.signing.verify(frame)
    assert again.signing.verify(station.ping())


@pytest.mark.parametrize("direction", ["sends", "receives"])
def test_timestamps_are_stored_15_s_ahead_when_half_of_that_is_used(direction):
    boat, station = Boat(), Station()
    sealer, packed = LinkSealer(boat.signing, 0), Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    expected = [0]
    for tick in range(1000):
        timestamp = NOW + tick * UNITS_HZ // 10
        boat.utc_s = UTC_S + tick * 0.1 + 1e-6
        if direction == "sends":
            sealer.seal(packed, 0)
        else:
            assert boat.signing.verify(station.ping(at=timestamp))
        if timestamp - expected[-1] > STORED_LEAD // 2:
            expected.append(timestamp)
    records = [from_text(text) for text in boat.saved[1:]]
    assert [record.timestamp for record in records] == [timestamp + STORED_LEAD for timestamp in expected]
    if direction == "receives":
        assert [record.streams for record in records[1:]] == [{(255, 190, 3): each.timestamp} for each in records[1:]]
    assert boat.both == [True] + [False] * (len(records) - 1)


def test_number_of_streams_is_limited():
    boat = Boat()
    for number in range(200):
        assert boat.signing.verify(Station(link=number, timestamp=NOW + number).ping())
    assert len(boat.signing._streams) == MAX_STREAMS
    again = boat.restarted()
    assert len(again.signing._streams) == MAX_STREAMS


@pytest.mark.parametrize(
    ("key", "timestamp"),
    [(bytes(32), 5), (bytes(31), 5), (KEY + b"x", 5), (b"", 0), (OTHER_KEY, MAX_TIMESTAMP + 1), (OTHER_KEY, 2**64 - 1)],
)
def test_invalid_key_or_timestamp_is_rejected(key, timestamp):
    boat = Boat()
    assert not boat.signing.set_key(key, timestamp)
    assert boat.signing.verify(Station().ping())


def test_setting_the_same_key_keeps_the_timestamps():
    boat, station = Boat(), Station()
    frame = station.ping()
    assert boat.signing.verify(frame)
    assert boat.signing.set_key(KEY, 0)
    assert not boat.signing.verify(frame)


def test_new_key_replaces_the_old_one_and_its_streams():
    boat = Boat()
    assert boat.signing.verify(Station().ping(at=MAX_TIMESTAMP))  # a station with a wrong clock
    assert not boat.signing.verify(Station(link=4).ping())
    assert boat.signing.set_key(OTHER_KEY, NOW)
    assert boat.both[-1]
    assert not boat.signing.verify(Station().ping(at=MAX_TIMESTAMP))
    assert boat.signing.verify(Station(OTHER_KEY).ping())
    assert KEY.hex().encode() not in boat.saved[-1]


def test_nothing_is_signed_or_verified_without_a_key():
    boat = Boat(key=None)
    sealer = LinkSealer(boat.signing, 0)
    assert (boat.signing.has_key, sealer.overhead_bytes) == (False, 0)
    assert not boat.signing.verify(Station().ping())
    with pytest.raises(ValueError, match="no key"):
        sealer.seal(Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0)), 0)
    assert boat.signing.set_key(KEY, 0)
    assert sealer.overhead_bytes == SIGNATURE_BYTES
    boat.signing.remove_key()
    assert not boat.signing.has_key
    assert boat.saved[-1] == b""
    assert boat.both == [True, True]


@given(
    st.binary(min_size=1, max_size=200) | st.binary(max_size=60).map(lambda tail: b"key " + KEY.hex().encode() + tail)
)
def test_invalid_stored_text_is_refused(content):
    signing = Signing(lambda: UTC_S, lambda *_words, **_more: None)
    assert signing.restore(Stored(content)) is KeyState.LOST
    assert signing.problem == "what is stored is no signing key"
    assert not signing.has_key


@pytest.mark.parametrize(
    ("content", "damage", "state", "problem"),
    [
        (None, "", KeyState.ABSENT, ""),
        (b"", "", KeyState.ABSENT, ""),
        (None, "a.0 is damaged", KeyState.LOST, "a.0 is damaged"),
        (b"", "a.0 is damaged", KeyState.LOST, "a.0 is damaged"),
        (b"rubbish", "a.0 is missing", KeyState.LOST, "a.0 is missing"),
        (b"key " + b"0" * 64 + b"\ntimestamp 1\n", "", KeyState.LOST, "what is stored is no signing key"),
    ],
)
def test_key_is_absent_only_without_damage(content, damage, state, problem):
    signing = Signing(lambda: UTC_S, lambda *_words, **_more: None)
    assert signing.restore(Stored(content, damage)) is state
    assert signing.problem == problem
    assert signing.set_key(KEY, NOW)
    assert signing.problem == ""
    signing.restore(Stored(content, damage))
    signing.remove_key()
    assert signing.problem == ""


def test_outdated_record_accepts_no_replay_on_a_missing_stream():
    boat, packed = Boat(), Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    LinkSealer(boat.signing, 0).seal(packed, 0)
    received_later = Station(link=9).ping(at=NOW + UNITS_HZ)
    assert boat.restarted().signing.verify(received_later)
    again = boat.restarted(damage="signing.key.0 is damaged")
    assert again.signing.has_key
    assert not again.signing.verify(received_later)
    station = Station(link=9)
    station.mav.decode(bytearray(LinkSealer(again.signing, 0).seal(packed, 0)))
    assert again.signing.verify(station.ping())


@pytest.mark.parametrize("change", ["none", "set", "removed"])
def test_key_of_a_late_disk_is_used_unless_it_was_changed_before(change):
    stored = Boat().saved[-1]
    boat = Boat(key=OTHER_KEY if change == "set" else None)
    if change == "removed":
        boat.signing.remove_key()
    boat.saved.clear()
    boat.both.clear()
    assert boat.signing.restore_late(Stored(stored)) is (change == "none")
    assert boat.signing.verify(Station().ping()) is (change == "none")
    assert boat.signing.has_key is (change != "removed")
    if change == "removed":
        assert (boat.saved, boat.both) == ([b""], [True])
    elif change == "set":
        assert (from_text(boat.saved[-1]).key, from_text(boat.saved[-1]).timestamp) == (OTHER_KEY, STORED_LEAD)
        assert boat.both == [True]


def test_vault_without_storage_is_empty_and_stores_nothing():
    results = []
    NO_VAULT.save(b"key")
    NO_VAULT.when_stored(results.append)
    assert (results, NO_VAULT.load()) == ([False], Stored())


def test_every_stored_timestamp_is_readable_at_the_next_start():
    digits = b"9" * 15
    boat = Boat(b"key %s\ntimestamp %s\nstream 255 190 1 %s\n" % (KEY.hex().encode(), digits, digits))
    assert boat.signing.set_key(KEY, 0)
    assert boat.restarted().signing.has_key


def test_clock_at_the_maximum_leaves_timestamps_for_peers():
    """A false GPS time sets the clock to the maximum; each own frame increases it, and the stations follow."""
    boat, station = Boat(), Station()
    boat.utc_s = 1_420_070_400 + (MAX_TIMESTAMP - 10) / UNITS_HZ
    sealer, ping = LinkSealer(boat.signing, 0), Codec(1, 1).pack(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    for number in range(30):
        station.mav.signing.timestamp = int.from_bytes(sealer.seal(ping, number)[-12:-6], "little")
        assert boat.signing.verify(station.ping())


MESSAGES = st.one_of(
    st.builds(mavlink.MAVLink_statustext_message, st.integers(0, 7), st.binary(max_size=50)),
    st.builds(
        mavlink.MAVLink_command_long_message,
        st.integers(0, 255), st.integers(0, 255), st.integers(0, 65535), st.integers(0, 255),
        *(st.floats(width=32),) * 7,
    ),
    st.builds(mavlink.MAVLink_ping_message, st.integers(0, 2**64 - 1), st.just(0), st.just(0), st.just(0)),
)  # fmt: skip


@given(MESSAGES, st.binary(min_size=32, max_size=32).filter(any), st.integers(0, 255), st.integers(0, 255), st.data())
def test_signatures_equal_those_of_pymavlink(message, key, link, sequence, data):
    timestamp = data.draw(st.integers(NOW + 1, MAX_TIMESTAMP))
    boat = Boat(key=key)
    # The boat uses the next timestamp.
    boat.signing.set_key(key, timestamp - 1)
    ours = LinkSealer(boat.signing, link).seal(Codec(1, 1).pack(copy.copy(message)), sequence)
    theirs = Station(key, timestamp, link, 1, 1)
    theirs.mav.seq = sequence
    assert ours == message.pack(theirs.mav)
    # Both accept the frame.
    assert Boat(key=key).signing.verify(ours)
    receiver = Station(key, NOW, link)
    assert receiver.mav.decode(bytearray(ours)).get_msgbuf() == ours
