"""What the sender of a refused message is told: the answer of its own protocol, and in words; not too often."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from firmware_py.common.records import Severity
from firmware_py.link.companion import BATTERY_STATUS, is_chosen
from firmware_py.link.context import LinkContext
from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.outbox import Priority

_DENIED = mavlink.MAV_RESULT_DENIED
_NAK, _FAIL_PROTECTED = 129, 9
_PAYLOAD_BYTES = 251


def deny(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Answer a message that its sender has no right to, unless too many were answered just now."""
    if type(message).id == BATTERY_STATUS and not is_chosen(context, message):
        return  # said to everybody, and nothing that was asked of us
    if not peer.denial_tokens.spend_one(now_s):
        return
    build = _ANSWERS.get(type(message).id)
    if build is not None:
        answer = build(message, message.get_srcSystem(), message.get_srcComponent())
        context.send(peer, answer, Priority.URGENT)
    systems = peer.transport.options.systems
    stranger = systems is not None and message.get_srcSystem() not in systems
    reason = f"system {message.get_srcSystem()} may not command here" if stranger else "it is not signed"
    context.send_text_limited(peer, Severity.WARNING, f"{type(message).msgname} refused: {reason}", now_s)


def _command(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_command_ack_message(message.command, _DENIED, 0, 0, system, component)


def _set_mode(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - one of a table
    return mavlink.MAVLink_command_ack_message(mavlink.MAVLINK_MSG_ID_SET_MODE, _DENIED, 0, 0, system, component)


def _parameter(message: Message, system: int, component: int) -> Message:
    name, error = text_of(message.param_id, 16), mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
    return mavlink.MAVLink_param_error_message(system, component, name, -1, error)


def _extended(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - one of a table
    name, kind = text_of(message.param_id, 16), message.param_type
    return mavlink.MAVLink_param_ext_ack_message(name, b"", kind, mavlink.PARAM_ACK_FAILED)


def _mission(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(system, component, mavlink.MAV_MISSION_DENIED, message.mission_type)


def _file(message: Message, system: int, component: int) -> Message:
    asked = bytes(message.payload)
    sequence = (int.from_bytes(asked[:2], "little") + 1) & 0xFFFF
    head = (*sequence.to_bytes(2, "little"), asked[2], _NAK, 1, asked[3], 0, 0, *bytes(4), _FAIL_PROTECTED)
    reply = bytes(head).ljust(_PAYLOAD_BYTES, b"\0")
    return mavlink.MAVLink_file_transfer_protocol_message(0, system, component, reply)


_ANSWERS: Mapping[int, Callable[[Message, int, int], Message]] = {
    11: _set_mode,
    23: _parameter,
    38: _mission,  # MISSION_WRITE_PARTIAL_LIST
    39: _mission,  # MISSION_ITEM
    44: _mission,  # MISSION_COUNT
    45: _mission,  # MISSION_CLEAR_ALL
    73: _mission,  # MISSION_ITEM_INT
    75: _command,
    76: _command,
    110: _file,
    323: _extended,
}
