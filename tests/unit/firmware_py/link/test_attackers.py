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
BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
ARM = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
READ = mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
READ_ALL = mavlink.MAVLink_param_request_list_message(1, 1)

NONE, PRESENT, LOST = "none", "present", "lost"
# The options of the link, and the state of the signing key.
POLICIES = {
    "`auto`, no key": ("policy=auto", NONE),
    "`open`": ("policy=open", PRESENT),
    "`signed-commands`": ("policy=signed-commands", PRESENT),
    "`signed-only`": ("policy=signed-only", PRESENT),
    "`trusted=1`": ("trusted=1", PRESENT),
    "all but `trusted=1`, key lost": ("policy=open", LOST),
}
COMMANDS, READS, HEARTBEATS, NOTHING = "commands", "reads", "heartbeats", "nothing"
BOUNDED = "less than 10 times the bytes sent"
DROPPED, DROPPED_WITHOUT_REPLY = "heartbeats; dropped after 10 s", "nothing; dropped after 10 s"
NOT_SERVED, SERVED = "a new peer waits during the flood", "a station with the key is served at once"
NONE_SERVED = "no peer is served"
SET, NOT_SET = "sets the key", "nothing is set"
COUNTED, NOT_COUNTED = "counts as a station", "STATION_SILENT is set"

# One column for each policy.
TABLE = {
    "sends unsigned frames": (COMMANDS, COMMANDS, READS, NOTHING, COMMANDS, NOTHING),
    "sends MAVLink 1": (COMMANDS, COMMANDS, READS, NOTHING, COMMANDS, NOTHING),
    "signs with another key": (COMMANDS, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING),
    "replays frames that the owner has signed": (COMMANDS, HEARTBEATS, HEARTBEATS, HEARTBEATS, HEARTBEATS, NOTHING),
    "has the key, but a system id that is not in `systems`": (READS, READS, READS, READS, READS, NOTHING),
    "forges the address of another in one frame": (BOUNDED, BOUNDED, BOUNDED, NOTHING, BOUNDED, NOTHING),
    "forges RADIO_STATUS over a network": (NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING),
    "connects over TCP and sends nothing": (
        DROPPED,
        DROPPED,
        DROPPED,
        DROPPED_WITHOUT_REPLY,
        DROPPED,
        DROPPED_WITHOUT_REPLY,
    ),
    "floods from many addresses": (NOT_SERVED, SERVED, SERVED, SERVED, NOT_SERVED, NONE_SERVED),
    "sends SETUP_SIGNING": (NOT_SET, NOT_SET, NOT_SET, NOT_SET, SET, NOT_SET),
    "imitates the heartbeats of the station": (COUNTED, NOT_COUNTED, NOT_COUNTED, NOT_COUNTED, COUNTED, NOT_COUNTED),
}


def result_of(rig, *frames):
    """Send frames of the attacker, each after the reply to the one before, and return their strongest effect in 2 s."""
    messages = [message for frame in frames for message in rig.give(frame, "attacker")]
    for _ in range(20):
        rig.tick_silently()
        messages += rig.replies("attacker")
    replies = [message.get_type() for message in without_unrequested(messages)]
    if rig.request_handler.intents:
        return COMMANDS
    if "PARAM_VALUE" in replies:
        return READS
    if replies:
        assert set(replies) == {"HEARTBEAT"}
        return HEARTBEATS
    return NOTHING


def send_unsigned(rig):
    return result_of(rig, *(rig.frame(message) for message in (BEAT, BEAT, READ, ARM)))


def send_mavlink_1(rig):
    old = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(old)
    read = mavlink1.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1).pack(old)
    arm = mavlink1.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
    ).pack(old)
    return result_of(rig, beat, beat, read, arm)


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
    return result_of(rig, *recorded)


def send_as_unlisted_system(rig):
    sign(rig)
    return send_unsigned(rig)


def forge_one_frame(rig):
    """Send one frame with the address of a victim; compare the bytes sent there in a minute with those of the frame."""
    frame = rig.frame(READ_ALL)
    rig.transport.inbox.append(("victim", frame))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    for _ in range(600):
        rig.endpoint.service(rig.now_s, [])
        rig.tick_silently()
    sent_bytes = sum(len(data) for address, data in rig.transport.sent if address == "victim")
    return NOTHING if not sent_bytes else BOUNDED if sent_bytes < 10 * len(frame) else "an amplifier"


def forge_radio_status(rig):
    frame = rig.frame(mavlink.MAVLink_radio_status_message(1, 1, 100, 0, 0, 0, 0))
    before = (rig.endpoint._gate.refused_frames, rig.endpoint._gate.false_signatures)
    result = result_of(rig, frame, frame)
    assert len(rig.endpoint._peers) == 0
    assert (rig.endpoint._gate.refused_frames, rig.endpoint._gate.false_signatures) == before
    return result


def connect_and_send_nothing(rig):
    rig.transport.is_datagram = False
    rig.transport.connected = ("attacker",)
    result = result_of(rig)
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
        return NONE_SERVED
    return SERVED if "station" in {peer.address for peer in rig.endpoint._peers} else NOT_SERVED


def set_up_signing(rig):
    had_key = rig.endpoint._signing.has_key
    for message in (BEAT, BEAT, mavlink.MAVLink_setup_signing_message(1, 1, NO_KEY, 0)):
        rig.send(message, address="attacker")
    if had_key and not rig.endpoint._signing.has_key:
        return SET
    rig.send(mavlink.MAVLink_setup_signing_message(1, 1, ANOTHER_KEY, NOW), address="attacker")
    assert rig.endpoint._signing.has_key is had_key
    assert ANOTHER_KEY.hex().encode() not in b"".join(rig.vault.contents)
    return NOT_SET


def imitate_the_station(rig):
    rig.send(BEAT, address="attacker")
    rig.send(BEAT, address="attacker")
    return NOT_COUNTED if rig.endpoint.station_s is None else COUNTED


RUNS = dict(
    zip(
        TABLE,
        (
            *(send_unsigned, send_mavlink_1, sign_with_another_key, replay, send_as_unlisted_system, forge_one_frame),
            *(forge_radio_status, connect_and_send_nothing, flood, set_up_signing, imitate_the_station),
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
    if key == PRESENT:
        assert rig.endpoint._signing.set_key(KEY, NOW)
    rig.tick()
    assert RUNS[attacker](rig) == dict(zip(POLICIES, TABLE[attacker], strict=True))[policy]


def test_the_page_shows_this_table():
    rows = [
        ("attacker", *POLICIES),
        ("---",) * (1 + len(POLICIES)),
        *((attacker, *cells) for attacker, cells in TABLE.items()),
    ]
    published = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    assert published in PAGE.read_text(), (
        f"docs/explanation/threat-model.md shows another table than this:\n{published}"
    )
