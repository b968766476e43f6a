"""Every attacker under every policy; the page of the threat model shows this table."""

import pytest
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.wire.urls import parse_options
from support.link import KEY, NOW, MemoryVault, sign, without_unrequested
from support.paths import ROOT

MAX_ACTIVE_PEERS = 8
QUIET_S = 10.0

PAGE = ROOT / "docs" / "explanation" / "threat-model.md"
ANOTHER_KEY, NO_KEY = bytes(32 * [9]), bytes(32)
BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
READ = mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
READ_ALL = mavlink.MAVLink_param_request_list_message(1, 1)

NONE, THERE, LOST = "none", "there", "lost"
# The options of the link, and what there is of a key.
POLICIES = {
    "`auto`, no key": ("policy=auto", NONE),
    "`open`": ("policy=open", THERE),
    "`signed-commands`": ("policy=signed-commands", THERE),
    "`signed-only`": ("policy=signed-only", THERE),
    "`trusted=1`": ("trusted=1", THERE),
    "all but `trusted=1`, key lost": ("policy=open", LOST),
}
COMMANDS, READS, HEARTBEATS, NOTHING = "commands", "reads", "heartbeats", "nothing"
BOUNDED = "less than 10 times the bytes sent"
DROPPED, DROPPED_UNHEARD = "heartbeats; dropped after 10 s", "nothing; dropped after 10 s"
WAITS, SERVED = "a new peer waits during the flood", "a station with the key is served at once"
SHUT = "no peer is served"
SET, KEPT = "sets the key", "nothing is set"
PASSES, FOUND_OUT = "counts as a station", "STATION_SILENT is set"

# One column for each policy.
TABLE = {
    "sends unsigned frames": (COMMANDS, COMMANDS, READS, NOTHING, COMMANDS, NOTHING),
    "sends MAVLink 1": (COMMANDS, COMMANDS, READS, NOTHING, COMMANDS, NOTHING),
    "signs with another key": (COMMANDS, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING),
    "replays frames that the owner has signed": (COMMANDS, HEARTBEATS, HEARTBEATS, HEARTBEATS, HEARTBEATS, NOTHING),
    "has the key, but a system id that is not in `systems`": (READS, READS, READS, READS, READS, NOTHING),
    "forges the address of another in one frame": (BOUNDED, BOUNDED, BOUNDED, NOTHING, BOUNDED, NOTHING),
    "forges RADIO_STATUS over a network": (NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING),
    "connects over TCP and sends nothing": (DROPPED, DROPPED, DROPPED, DROPPED_UNHEARD, DROPPED, DROPPED_UNHEARD),
    "floods from many addresses": (WAITS, SERVED, SERVED, SERVED, WAITS, SHUT),
    "sends SETUP_SIGNING": (KEPT, KEPT, KEPT, KEPT, SET, KEPT),
    "imitates the heartbeats of the station": (PASSES, FOUND_OUT, FOUND_OUT, FOUND_OUT, PASSES, FOUND_OUT),
}


def what_it_brings(rig, *frames):
    """Send frames, each after the reply to the one before, wait for an interval, and return the result."""
    reports = [message for frame in frames for message in rig.give(frame, "attacker")]
    for _ in range(20):
        rig.tick_silently()
        reports += rig.replies("attacker")
    replies = [message.get_type() for message in without_unrequested(reports)]
    if rig.request_handler.intents:
        return COMMANDS
    if "PARAM_VALUE" in replies:
        return READS
    if replies:
        assert set(replies) == {"HEARTBEAT"}
        return HEARTBEATS
    return NOTHING


def send_unsigned(rig):
    return what_it_brings(rig, *(rig.frame(message) for message in (BEAT, BEAT, READ, ARM)))


def send_mavlink_1(rig):
    old = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(old)
    read = mavlink1.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1).pack(old)
    arm = mavlink1.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0).pack(old)
    return what_it_brings(rig, beat, beat, read, arm)


def sign_with_another_key(rig):
    sign(rig, ANOTHER_KEY)
    return send_unsigned(rig)


def replay(rig):
    sign(rig)
    recorded = [rig.frame(message) for message in (BEAT, READ, ARM)]
    for frame in recorded:
        rig.give(frame, "owner")
    assert rig.request_handler.intents or rig.endpoint.key_problem
    rig.request_handler.requests.clear()
    return what_it_brings(rig, *recorded)


def send_as_unlisted_system(rig):
    sign(rig)
    return send_unsigned(rig)


def forge_one_frame(rig):
    """Return the bytes of a minute to an address without a peer."""
    frame = rig.frame(READ_ALL)
    rig.transport.inbox.append(("victim", frame))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    for _ in range(600):
        rig.endpoint.service(rig.now_s, [])
        rig.tick_silently()
    drawn = sum(len(data) for address, data in rig.transport.sent if address == "victim")
    return NOTHING if not drawn else BOUNDED if drawn < 10 * len(frame) else "an amplifier"


def forge_radio_status(rig):
    frame = rig.frame(mavlink.MAVLink_radio_status_message(1, 1, 100, 0, 0, 0, 0))
    before = (rig.endpoint._gate.refused_frames, rig.endpoint._gate.false_signatures)
    result = what_it_brings(rig, frame, frame)
    assert len(rig.endpoint._peers) == 0
    assert (rig.endpoint._gate.refused_frames, rig.endpoint._gate.false_signatures) == before
    return result


def connect_and_say_nothing(rig):
    rig.transport.is_datagram = False
    rig.transport.connected = ("attacker",)
    result = what_it_brings(rig)
    assert len(rig.endpoint._peers) == 0
    rig.tick(seconds=QUIET_S)
    assert rig.transport.dropped == ["attacker"]
    return f"{result}; dropped after 10 s"


def flood(rig):
    for number in range(4 * MAX_ACTIVE_PEERS):
        rig.prove(("203.0.113.1", number))
        rig.prove((f"203.0.113.{number}", 1))
    sign(rig)
    rig.send(BEAT, address="station")
    if not rig.endpoint._signing.has_key:
        rig.send(BEAT, address="station")
    if len(rig.endpoint._peers) == 0:
        return SHUT
    return SERVED if "station" in {peer.address for peer in rig.endpoint._peers} else WAITS


def set_up_signing(rig):
    was_there = rig.endpoint._signing.has_key
    for message in (BEAT, BEAT, mavlink.MAVLink_setup_signing_message(1, 1, NO_KEY, 0)):
        rig.send(message, address="attacker")
    if was_there and not rig.endpoint._signing.has_key:
        return SET
    rig.send(mavlink.MAVLink_setup_signing_message(1, 1, ANOTHER_KEY, NOW), address="attacker")
    assert rig.endpoint._signing.has_key is was_there
    assert ANOTHER_KEY.hex().encode() not in b"".join(rig.vault.contents)
    return KEPT


def pass_for_a_station(rig):
    rig.send(BEAT, address="attacker")
    rig.send(BEAT, address="attacker")
    return FOUND_OUT if rig.endpoint.station_s is None else PASSES


RUNS = dict(
    zip(
        TABLE,
        (
            *(send_unsigned, send_mavlink_1, sign_with_another_key, replay, send_as_unlisted_system, forge_one_frame),
            *(forge_radio_status, connect_and_say_nothing, flood, set_up_signing, pass_for_a_station),
        ),
        strict=True,
    )
)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("attacker", TABLE)
def test_what_an_attacker_achieves(make_rig, attacker, policy):
    options, key = POLICIES[policy]
    if "`systems`" in attacker:
        options += "&systems=254"
    vault = MemoryVault()
    vault.damage = "damaged" * (key == LOST)
    rig = make_rig(vault, options=parse_options(options), addresses=())
    if key == THERE:
        assert rig.endpoint._signing.set_key(KEY, NOW)
    rig.tick()
    assert RUNS[attacker](rig) == dict(zip(POLICIES, TABLE[attacker], strict=True))[policy]


def test_the_page_shows_this_table():
    rows = [("attacker", *POLICIES), ("---",) * (1 + len(POLICIES)), *((who, *cells) for who, cells in TABLE.items())]
    published = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    assert published in PAGE.read_text(), (
        f"docs/explanation/threat-model.md shows another table than this:\n{published}"
    )
