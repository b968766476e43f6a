"""Access rights on a link: policies, keys, allow-lists, MAVLink 1."""

import pytest
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Arm, SetParameter
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Event, Severity
from firmware_py.link.access import RADIO_STATUS, Gate, Permission, make_reading_test
from firmware_py.link.files.payload import Error, Opcode
from firmware_py.link.signing import Signing
from firmware_py.link.wire.frames import Frame
from firmware_py.link.wire.urls import PLAIN, LinkClass, LinkOptions, parse_options
from support.link import KEY, NOW, MemoryVault, sign

MAX_BURST_DENIALS = 20
MAX_LATE_HEARTBEATS = 4

MISSION_ACK = mavlink.mavlink_map[mavlink.MAVLINK_MSG_ID_MISSION_ACK]
HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
ARM = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
DISARM = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0)
GET_HOME = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_GET_HOME_POSITION, 0, 0, 0, 0, 0, 0, 0, 0)
SET = mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 33.0, mavlink.MAV_PARAM_TYPE_REAL32)
READ = mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
SETUP = mavlink.MAVLink_setup_signing_message(1, 1, KEY, NOW)
REMOVE = mavlink.MAVLink_setup_signing_message(1, 1, bytes(32), 0)


@pytest.fixture
def linked(make_rig):
    """Makes a rig with a link of the given options, and an optional stored key."""

    def make(options="", *, key=False, **more):
        rig = make_rig(options=parse_options(options) if options else parse_options("policy=auto"), **more)
        rig.endpoint.service(0.0, [])
        rig.tick()
        if key:
            assert rig.endpoint._signing.set_key(KEY, NOW)
        return rig

    return make


def kinds_in_order(messages):
    return [message.get_type() for message in messages]


def kinds(messages):
    return {message.get_type() for message in messages} - {"STATUSTEXT"}


# --------------------------------------------------------------------------- policies


@pytest.mark.parametrize(
    ("options", "key", "commands", "reads"),
    [
        ("", False, True, True),
        ("", True, False, True),
        ("trusted=1", True, True, True),
        ("policy=open", True, True, True),
        ("policy=signed-commands", False, False, True),
        ("policy=signed-commands", True, False, True),
        ("policy=signed-only", False, False, False),
        ("policy=signed-only", True, False, False),
        ("policy=signed-only&trusted=1", True, False, False),
    ],
)
def test_unsigned_frame_has_the_rights_of_the_policy(linked, options, key, commands, reads):
    rig = linked(options, key=key)
    rig.send(ARM, SET, BEAT)
    assert bool(rig.request_handler.intents) is commands
    assert ("PARAM_VALUE" in kinds(rig.send(READ))) is reads


@pytest.mark.parametrize("options", ["", "policy=open", "policy=signed-commands", "policy=signed-only"])
def test_signed_frame_may_command_on_any_link(linked, options, of):
    rig = linked(options, key=True)
    sign(rig)
    assert of(rig.send(ARM), "COMMAND_ACK")[0].result == 0
    rig.send(SET)
    assert rig.request_handler.intents == [Arm(True, False), SetParameter("CTL_K1", 33.0)]


@pytest.mark.parametrize("options", ["", "policy=open", "policy=signed-only", "trusted=1"])
def test_wrong_signature_is_refused_on_any_link(linked, options, texts):
    rig = linked(options, key=True)
    sign(rig)
    frame = rig.frame(ARM)
    rig.give(frame)
    assert len(rig.request_handler.intents) == 1
    replies = rig.give(frame)  # a replay
    assert kinds(replies) == set()
    assert "Signature refused" in texts(replies)[0]
    sign(rig, bytes(32 * [9]))
    assert kinds(rig.send(ARM, READ)) == set()
    assert len(rig.request_handler.intents) == 1


def test_signature_is_ignored_without_a_key(linked):
    rig = linked()
    sign(rig)
    rig.send(ARM)
    assert rig.request_handler.intents == [Arm(True, False)]
    strict = linked("policy=signed-only")
    sign(strict)
    assert strict.send(ARM) == []


def test_frames_are_signed_after_a_key_is_set(linked):
    rig = linked("trusted=1")
    assert all(message.get_msgbuf()[2] == 0 for message in rig.tick(seconds=1.0))
    rig.send(SETUP)
    rig.tick_silently(seconds=1.0)
    receiver = mavlink.MAVLink(None)
    receiver.signing.secret_key, receiver.signing.timestamp = KEY, NOW
    received = receiver.parse_buffer(b"".join(data for _, data in rig.transport.sent))
    assert len(received) > 5
    assert all(message.get_signed() for message in received)


def test_signatures_count_for_the_rate_of_a_line(linked):
    rig = linked("policy=open", key=True, byte_rate=200.0, has_radio_rates=True)
    rig.replies()
    sent = 0
    for _ in range(300):
        rig.tick_silently()
        sent += sum(len(data) for _, data in rig.transport.sent)
        rig.replies()
    assert 0.7 * 200 * 30 < sent <= 200 * 30 + 280


def test_unsigned_sender_gets_no_reply_on_a_signed_link(linked):
    rig = linked("policy=signed-only", key=True, addresses=())
    assert rig.send(BEAT, READ, address="stranger") == []
    rig.tick_silently(seconds=1.0)
    assert rig.transport.sent == []
    sign(rig)
    assert rig.send(BEAT, address="station") != []


def test_sender_with_an_old_timestamp_gets_a_signed_heartbeat_only(linked):
    rig = linked("policy=signed-only", key=True, addresses=())
    sign(rig)
    rig.send(BEAT, address="station")
    rig.station.signing.timestamp = NOW - 5
    old = rig.frame(ARM)
    before = len(rig.request_handler.intents)
    replies = [message for _ in range(50) for message in rig.give(old, address="stranger")]
    assert [message.get_type() for message in replies] == ["HEARTBEAT"] * MAX_LATE_HEARTBEATS
    for seconds, count in ((0.95, 0), (0.05, 1)):
        rig.now_s += seconds
        assert kinds_in_order(rig.give(old, address="stranger")) == ["HEARTBEAT"] * count
    rig.tick_silently(seconds=1.0)
    assert {address for address, _ in rig.transport.sent} == {"station"}
    assert len(rig.request_handler.intents) == before


def test_radio_status_needs_no_signature(linked):
    rig = linked("policy=signed-only", key=True)
    before = rig.endpoint._gate.refused_frames
    rig.send(mavlink.MAVLink_radio_status_message(1, 1, 100, 0, 0, 0, 0))
    assert rig.endpoint._gate.refused_frames == before
    rig.send(BEAT)
    assert rig.endpoint._gate.refused_frames == before + 1


# --------------------------------------------------------------------------- refusals


def test_refusal_is_sent_as_the_reply_of_the_protocol(linked, of, texts):
    rig = linked("policy=signed-commands")
    replies = rig.send(ARM, SET)
    denials = [message.to_dict() for message in replies if message.get_type() in ("COMMAND_ACK", "PARAM_ERROR")]
    error = mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
    assert denials == [
        mavlink.MAVLink_command_ack_message(
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_RESULT_DENIED, 0, 0, 255, 190
        ).to_dict(),
        {**mavlink.MAVLink_param_error_message(255, 190, b"CTL_K1", -1, error).to_dict(), "param_id": "CTL_K1"},
    ]
    assert texts(replies) == ["COMMAND_LONG refused: not signed", "PARAM_SET refused: not signed"]
    (extended,) = of(
        rig.send(mavlink.MAVLink_param_ext_set_message(1, 1, b"CTL_K1", b"4", mavlink.MAV_PARAM_TYPE_REAL32)),
        "PARAM_EXT_ACK",
    )
    assert (extended.param_id, extended.param_result) == ("CTL_K1", mavlink.PARAM_ACK_FAILED)
    assert of(rig.send(mavlink.MAVLink_param_ext_request_read_message(1, 1, b"CTL_K1", -1)), "PARAM_EXT_VALUE")
    others = [
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 1, 2),
        mavlink.MAVLink_mission_item_message(1, 1, 0, 0, 16, 2, 1, 0, 0, 0, 0, 0, 0, 0, 1),
        mavlink.MAVLink_command_int_message(1, 1, 3, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_set_mode_message(1, 1, Mode.HOLD),
        mavlink.MAVLink_mission_count_message(1, 1, 3, 0),
        mavlink.MAVLink_mission_item_int_message(1, 1, 0, 0, 16, 2, 1, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_manual_control_message(1, 0, 1000, 0, 0, 0),
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0),
        mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [5, 0, 2, Opcode.CREATE, *[0] * 247]),
    ]
    replies = [message for other in others for message in rig.send(other)]
    assert rig.request_handler.intents == []
    denials = [message.to_dict() for message in replies if message.get_type() != "STATUSTEXT"]
    denied = mavlink.MAV_MISSION_DENIED
    expected = [
        *(MISSION_ACK(255, 190, denied, kind, 0) for kind in (2, 1)),
        *(
            mavlink.MAVLink_command_ack_message(number, mavlink.MAV_RESULT_DENIED, 0, 0, 255, 190)
            for number in (mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAVLINK_MSG_ID_SET_MODE)
        ),
        *(MISSION_ACK(255, 190, denied, 0, 0) for _ in range(3)),
        mavlink.MAVLink_file_transfer_protocol_message(
            0, 255, 190, [6, 0, 2, Opcode.NAK, 1, Opcode.CREATE, *[0] * 6, Error.FILE_PROTECTED, *[0] * 238]
        ),
    ]
    assert denials == [message.to_dict() for message in expected]


def test_request_for_data_is_not_a_command(linked, of):
    rig = linked("policy=signed-commands")
    rig.tick(home=None)
    (ack,) = of(rig.send(GET_HOME), "COMMAND_ACK")
    assert ack.result != mavlink.MAV_RESULT_DENIED
    read = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [5, 0, 0, Opcode.OPEN_READ, *[0] * 247])
    (reply,) = of(rig.send(read), "FILE_TRANSFER_PROTOCOL")
    assert reply.payload[12] != Error.FILE_PROTECTED
    assert of(rig.send(mavlink.MAVLink_param_request_list_message(1, 1)), "PARAM_VALUE")


def test_refusals_are_limited(linked):
    rig = linked("policy=signed-commands")
    replies = [message for _ in range(50) for message in rig.send(*[ARM] * 20)]
    assert len([message for message in replies if message.get_type() == "COMMAND_ACK"]) == MAX_BURST_DENIALS
    for seconds, count in ((2.0, 10), (0.19, 0), (0.02, 1)):
        rig.now_s += seconds
        replies = rig.send(*[ARM] * 20)
        assert len([message for message in replies if message.get_type() == "COMMAND_ACK"]) == count
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(("later_frames", "is_verified"), [(15, True), (16, False)])
def test_sixteen_frames_of_signed_messages_are_marked(later_frames, is_verified):
    """A message by satellite is signed as a whole, and its frames are admitted afterwards."""
    gate = Gate(Signing(lambda: 1.7e9, lambda *_, **__: None))
    options = LinkOptions(link_class=LinkClass.MESSAGES)
    frames = [Frame(HEARTBEAT, bytes((0xFD, 1, 0, 0, number, 255, 190, 0, 0, 0, 1, 0, 0))) for number in range(20)]
    for frame in frames[: 1 + later_frames]:
        gate.mark_signed(frame.data)
    for verified in (is_verified, False):  # the second time it is a replay
        assert gate.admit(frames[:1], options, line=False) == [(frames[0], Permission.COMMANDER, verified)]
    gate.accepts_mavlink1 = False
    assert gate.refused_frames == gate.false_signatures == 0
    assert gate.admit([Frame(HEARTBEAT, b"\xfe" + bytes(10))] * 2, options, line=False) == []
    assert (gate.refused_frames, gate.false_signatures) == (2, 0)
    assert gate.admit(
        [Frame(RADIO_STATUS, b"\xfe" + bytes(10)), Frame(RADIO_STATUS, b"\xfd" + bytes(10))], PLAIN, line=True
    ) == [(Frame(RADIO_STATUS, b"\xfd" + bytes(10)), Permission.READER, False)]
    assert gate.admit([Frame(RADIO_STATUS, b"\xfd" + bytes(10))], PLAIN, line=False) == []
    assert gate.refused_frames == 3


def test_exposed_open_link_is_reported_at_start(make_rig, texts):
    reports = ["Open link: anyone on memory can command; set a signing key"]
    for options, exposed, key, expected in [
        ("policy=auto", True, False, reports),
        ("policy=auto", False, False, []),
        ("policy=auto", True, True, []),
        ("policy=open", True, True, reports),
        ("policy=signed-only", True, False, []),
        ("trusted=1", True, False, []),
    ]:
        vault = make_rig().vault
        if key:
            vault.save(b"key %s\ntimestamp 1\n" % KEY.hex().encode())
        rig = make_rig(vault=vault, options=parse_options(options), is_exposed=exposed)
        assert [event.text for event in rig.endpoint.start_events] == expected
        assert texts(rig.tick()) == expected


# The messages that only request data for their sender; all others, also those of later versions, are commands.
READING = {
    getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    for name in (
        *("HEARTBEAT", "PING", "TIMESYNC", "RADIO_STATUS", "REQUEST_DATA_STREAM"),
        *("PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_EXT_REQUEST_READ", "PARAM_EXT_REQUEST_LIST"),
        *("MISSION_REQUEST_LIST", "MISSION_REQUEST_PARTIAL_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT"),
        *("MISSION_ACK", "LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END"),
    )
}
COMMAND_INT, COMMAND_LONG = mavlink.MAVLINK_MSG_ID_COMMAND_INT, mavlink.MAVLINK_MSG_ID_COMMAND_LONG
FILE_TRANSFER = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL


def test_reading_messages_and_file_operations_need_no_rights_to_command():
    only_reads = make_reading_test(frozenset({mavlink.MAV_CMD_REQUEST_MESSAGE}))
    message = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 0, 0, 0, 0, 0, 0, 0)
    others = set(range(13_000)) - {COMMAND_INT, COMMAND_LONG, FILE_TRANSFER}
    assert {number for number in others if only_reads(number, message)} == READING
    assert [only_reads(number, message) for number in (COMMAND_INT, COMMAND_LONG)] == [True, True]
    assert not only_reads(COMMAND_LONG, ARM)
    opcodes = set()
    for opcode in range(256):
        request = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [5, 0, 2, opcode, *[0] * 247])
        if only_reads(FILE_TRANSFER, request):
            opcodes.add(opcode)
    assert opcodes == {
        *(Opcode.NONE, Opcode.TERMINATE, Opcode.RESET, Opcode.LIST, Opcode.LIST_WITH_TIME),
        *(Opcode.OPEN_READ, Opcode.READ, Opcode.BURST_READ, Opcode.CHECKSUM),
    }


# --------------------------------------------------------------------------- systems and MAVLink 1


def test_only_listed_systems_may_command(linked, texts):
    rig = linked("systems=254,255")
    rig.send(ARM)
    assert len(rig.request_handler.intents) == 1
    rig.station = mavlink.MAVLink(None, srcSystem=7, srcComponent=190)
    replies = rig.send(ARM)
    assert "system 7 may not command here" in texts(replies)[0]
    assert "PARAM_VALUE" in kinds(rig.send(READ))
    assert len(rig.request_handler.intents) == 1


def test_signed_frame_of_an_unlisted_system_may_not_command(linked):
    rig = linked("systems=7&trusted=1", key=True)
    sign(rig)
    rig.send(ARM, REMOVE)
    assert rig.request_handler.intents == []
    assert rig.endpoint._signing.has_key


def test_parameter_disables_mavlink1(linked):
    rig = linked()
    old = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
    arm = mavlink1.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
    ).pack(old)
    assert arm[0] == 0xFE
    rig.give(arm)
    assert len(rig.request_handler.intents) == 1
    rig.request_handler.values = rig.request_handler.values.replaced("LNK_MAVLINK1", 0)
    rig.tick()
    assert rig.give(arm) == []
    assert len(rig.request_handler.intents) == 1
    rig.send(DISARM)
    assert len(rig.request_handler.intents) == 2


def test_mavlink1_may_not_command_if_signatures_are_required(linked):
    rig = linked("policy=signed-commands", key=True)
    old = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
    # At the offset of the signed flag of MAVLink 2, a MAVLink 1 frame has its sequence number.
    old.seq = 1
    rig.give(
        mavlink1.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0).pack(
            old
        )
    )
    assert rig.request_handler.intents == []


# --------------------------------------------------------------------------- SETUP_SIGNING


def test_key_is_set_over_a_trusted_link_only(linked, texts):
    rig = linked()
    (refusal,) = texts(rig.send(SETUP))
    assert all(part in refusal for part in ("SETUP_SIGNING refused", "rambler key set", "?trusted=1"))
    assert not rig.endpoint._signing.has_key
    assert rig.vault.contents == []


@pytest.mark.parametrize("options", ["trusted=1", "trusted=1&policy=signed-only", "trusted=1&policy=signed-commands"])
def test_key_is_set_and_removed_over_a_trusted_link_with_any_policy(linked, options, texts):
    rig = linked(options)
    assert texts(rig.send(SETUP)) == ["Signing key set"]
    assert KEY.hex().encode() in rig.vault.contents[-1]
    assert texts(rig.send(REMOVE)) == ["Signing key removed"]
    assert rig.vault.contents[-1] == b""
    assert rig.vault.both[0]
    assert rig.vault.both[-1]
    assert not rig.endpoint._signing.has_key


def test_key_is_not_sent_to_any_peer(linked):
    rig = linked("trusted=1", addresses=("station", "other"))
    rig.transport.inbox.append(("station", rig.frame(SETUP)))
    rig.endpoint.service(0.0, [100])
    rig.tick_silently(seconds=1.0)
    assert KEY not in b"".join(data for _, data in rig.transport.sent)


def test_failed_storage_of_a_key_is_reported(linked, texts):
    rig = linked("trusted=1")
    rig.vault.at_once = False
    assert texts(rig.send(SETUP)) == []
    rig.vault.waiting.pop()(False)
    assert texts(rig.replies()) == ["Signing key set, but this could not be stored"]


@pytest.mark.parametrize(("key", "timestamp"), [(bytes(32), 1), (KEY, 2**64 - 1), (KEY, 2**48)])
def test_invalid_key_is_refused(linked, key, timestamp, texts):
    rig = linked("trusted=1", key=True)
    before = list(rig.vault.contents)
    replies = rig.send(mavlink.MAVLink_setup_signing_message(1, 1, key, timestamp))
    assert texts(replies) == ["SETUP_SIGNING refused: no key, or no timestamp"]
    assert rig.vault.contents == before


def test_setup_signing_of_another_system_is_ignored(linked):
    rig = linked("trusted=1")
    rig.send(mavlink.MAVLink_setup_signing_message(2, 1, KEY, NOW))
    assert not rig.endpoint._signing.has_key


def test_station_with_another_key_sets_it_over_a_trusted_link(linked):
    rig = linked("trusted=1", key=True)
    other = bytes(32 * [9])
    sign(rig, other)
    rig.send(mavlink.MAVLink_setup_signing_message(1, 1, other, NOW))
    rig.send(ARM)
    assert rig.request_handler.intents == [Arm(True, False)]


def test_key_and_timestamps_are_restored_at_the_next_start(linked, make_rig):
    rig = linked("policy=signed-only&trusted=1")
    rig.send(SETUP)
    sign(rig)
    replayed = rig.frame(ARM)
    rig.give(replayed)
    rig.endpoint.close()
    again = make_rig(vault=rig.vault, options=parse_options("policy=signed-only"))
    again.station = rig.station
    assert again.endpoint.key_problem == ""
    again.give(replayed)
    assert again.request_handler.intents == []
    again.send(ARM)
    assert again.request_handler.intents == [Arm(True, False)]


# --------------------------------------------------------------------------- a key that was lost


@pytest.fixture
def keyless(make_rig):
    """Makes a rig of the given options whose key was lost."""

    def make(options="policy=auto", **more):
        vault = MemoryVault()
        vault.damage = "signing.key.0 is damaged, signing.key.1 is damaged"
        rig = make_rig(vault=vault, options=parse_options(options), **more)
        rig.endpoint.service(0.0, [])
        rig.tick()
        return rig

    return make


UNTRUSTED = ["policy=auto", "policy=open", "policy=signed-commands", "policy=signed-only", "systems=255"]


@pytest.mark.parametrize("options", UNTRUSTED)
def test_untrusted_link_accepts_nothing_after_loss_of_the_key(keyless, options):
    rig = keyless(options)
    assert rig.endpoint.key_problem == "signing.key.0 is damaged, signing.key.1 is damaged"
    for key in (None, KEY):
        if key:
            sign(rig)
        assert kinds(rig.send(ARM, SET, READ, SETUP, REMOVE, BEAT)) == set()
    rig.give(mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink1.MAVLink(None, srcSystem=255)))
    assert rig.request_handler.intents == []
    assert rig.endpoint.station_s is None
    assert rig.vault.contents == []


def test_sender_gets_no_reply_after_loss_of_the_key(keyless):
    rig = keyless(addresses=())
    for _ in range(3):
        assert rig.send(BEAT, READ, ARM, address="stranger") == []
        rig.tick_silently(seconds=1.0)
    assert rig.transport.sent == []


def test_loss_of_the_key_is_reported_to_permanent_peers_unsigned(keyless, texts):
    rig = keyless()
    replies = rig.tick(seconds=1.0, events=(Event(Severity.CRITICAL, "Signing key lost"),))
    assert texts(replies) == ["Signing key lost"]
    assert "HEARTBEAT" in kinds(replies)
    assert all(message.get_msgbuf()[2] == 0 for message in replies)


@pytest.mark.parametrize("key", [None, KEY])
def test_trusted_link_works_after_loss_of_the_key(keyless, of, key):
    rig = keyless("trusted=1")
    if key:
        sign(rig)  # a station that has it still
    assert of(rig.send(ARM), "COMMAND_ACK")[0].result == 0
    assert rig.request_handler.intents == [Arm(True, False)]


@pytest.mark.parametrize(
    ("setup", "text", "unsigned_commands"),
    [(SETUP, "Signing key set", False), (REMOVE, "Signing key removed", True)],
)
def test_lost_key_is_set_or_removed_over_a_trusted_link(keyless, setup, text, unsigned_commands, texts):
    rig = keyless("trusted=1")
    assert texts(rig.send(setup)) == [text]
    assert rig.endpoint.key_problem == ""
    rig.transport.options = parse_options("policy=auto")
    rig.send(ARM)
    assert bool(rig.request_handler.intents) is unsigned_commands
    if not unsigned_commands:
        sign(rig)
        rig.send(ARM)
        assert rig.request_handler.intents == [Arm(True, False)]
