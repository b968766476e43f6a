"""Services of one or two messages: time, radio status, console, battery of a companion, signing key; and refusals."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence

from firmware_py.common.intents import ReportBattery
from firmware_py.common.interfaces import Vault
from firmware_py.common.records import Severity
from firmware_py.link.access import SETUP_SIGNING
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer
from firmware_py.link.signing import Signing
from firmware_py.link.telemetry.fields import INT16_MAX, UINT16_MAX
from firmware_py.link.wire.dialect import Message, encode_text, mavlink
from firmware_py.link.wire.outbox import Priority

_REMEMBERED = 32
_MAX_UTC_S = 1e11

_SERIAL_CONTROL = 126
_REPLY = mavlink.SERIAL_CONTROL_FLAG_REPLY
_NO_SHELL = b"no shell over MAVLink; log in by ssh\r\n"
_DATA = _NO_SHELL.ljust(70, b"\0")

BATTERY_STATUS = 147
INTERVAL_S = 0.5  # minimum interval between two samples

_UNTRUSTED = "SETUP_SIGNING refused: set the key by `rambler key set`, or over a link with ?trusted=1 in its URL"

_DENIED = mavlink.MAV_RESULT_DENIED
_NAK, _FAIL_PROTECTED = 129, 9
_PAYLOAD_BYTES = 251


class Timesync:
    """Answers PING and TIMESYNC, and offers the UTC of stations to the clock."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context
        self._answered: OrderedDict[tuple[Peer, int, int], tuple[int, int]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {2: self._system_time, 4: self._ping, 111: self._timesync}

    def _ping(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Answer a ping to all, and the first of its kind that is addressed to this boat.

        By the specification an addressed ping is a reply, but some stations send requests so, and the boat sends none.
        Only the first is answered: two systems that answer every ping would never stop.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.target_system:
            asker, mark = (peer, *sender), (message.time_usec, message.seq)
            if self._answered.get(asker) == mark:
                return
            keep_latest(self._answered, asker, mark, _REMEMBERED)
        reply = mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender)
        self._context.send(peer, reply, Priority.URGENT)

    def _timesync(self, peer: Peer, message: Message, now_s: float) -> None:
        """Answer a request with the time since start; a reply to another system is ignored."""
        if message.tc1:
            return
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.mavlink_map[111](int(now_s * 1e9), message.ts1, sender, component)
        self._context.send(peer, reply, Priority.URGENT)

    def _system_time(self, peer: Peer, message: Message, now_s: float) -> None:
        """Offer the UTC of a ground station to a clock that is clearly wrong (`CLK_SET`)."""
        utc_s = message.time_unix_usec * 1e-6
        offer = self._context.suppliers.offer_utc
        if offer is not None and peer.ground_station_s is not None and 0.0 < utc_s < _MAX_UTC_S:
            offer(utc_s, now_s)


def note_radio_status(peer: Peer, message: Message, now_s: float) -> None:
    """Send no faster than the radio modem in a serial line accepts."""
    peer.keep_pace(message.txbuf, now_s)


class Shell:
    """Replies to the console of a ground station that there is no shell; without a reply it would wait forever."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {_SERIAL_CONTROL: self._answer}

    def _answer(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Answer console input with one line; a reply is not answered."""
        if message.device == mavlink.SERIAL_CONTROL_DEV_SHELL and message.count and not message.flags & _REPLY:
            make = mavlink.MAVLink_serial_control_message
            self._context.send(peer, make(message.device, _REPLY, 0, 0, len(_NO_SHELL), _DATA))


class CompanionBattery:
    """Takes BATTERY_STATUS of the first battery from the component that PWR_COMPANION names; ignores others."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._taken_s = -math.inf

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {BATTERY_STATUS: self._battery}

    def _battery(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take voltage, current and charge of the battery from the component PWR_COMPANION."""
        if message.id != 0 or not is_chosen(self._context, message) or now_s - self._taken_s < INTERVAL_S:
            return
        self._taken_s = now_s
        self._context.request_or_warn(peer, message, reported(message), now_s)


def is_chosen(context: LinkContext, message: Message) -> bool:
    """Return whether the sender of a message is the component that PWR_COMPANION names."""
    chosen = int(context.request_handler.parameters()["PWR_COMPANION"])
    return chosen != 0 and (message.get_srcSystem(), message.get_srcComponent()) == (context.system, chosen)


def reported(message: Message) -> ReportBattery:
    """Return the values of a BATTERY_STATUS, in which a current out of the battery is positive."""
    millivolts = _known(message.voltages, UINT16_MAX) + _known(message.voltages_ext, 0)
    centiamperes, percent = message.current_battery, message.battery_remaining
    return ReportBattery(
        voltage_v=sum(millivolts) * 1e-3 if millivolts else None,
        current_a=None if centiamperes == -1 else -0.01 * centiamperes,
        charge=None if percent < 0 else 0.01 * percent,
        temperature_c=None if message.temperature == INT16_MAX else 0.01 * message.temperature,
    )


def _known(cells: Sequence[int], unknown: int) -> list[int]:
    return [cell for cell in cells if cell != unknown]


class KeySetup:
    """Sets or removes the signing key (SETUP_SIGNING), over a trusted link only; zeros for key and timestamp remove."""

    def __init__(self, context: LinkContext, signing: Signing, vault: Vault) -> None:
        """Take the context, the signing state and its storage."""
        self._context = context
        self._signing = signing
        self._vault = vault

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {SETUP_SIGNING: self._set}

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        if not peer.transport.options.trusted:
            self._context.send_text_limited(peer, Severity.WARNING, _UNTRUSTED, now_s)
            return
        key, timestamp = bytes(message.secret_key), message.initial_timestamp
        if not any(key) and timestamp == 0:
            self._signing.remove_key()
            done = "Signing key removed"
        elif self._signing.set_key(key, timestamp):
            done = "Signing key set"
        else:
            self._context.send_text_limited(
                peer, Severity.WARNING, "SETUP_SIGNING refused: no key, or no timestamp", now_s
            )
            return
        self._vault.when_stored(lambda stored: self._stored(done, stored=stored))

    def _stored(self, done: str, *, stored: bool) -> None:
        if stored:
            self._context.send_text_all(Severity.NOTICE, done)
        else:
            self._context.send_text_all(Severity.ERROR, f"{done}, but this could not be stored")
        self._context.flush_all()


def deny(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Send the refusal of a message without rights, by its protocol and as a text, at a limited rate."""
    if type(message).id == BATTERY_STATUS and not is_chosen(context, message):
        return  # a broadcast, not a request to the boat
    if not peer.denial_tokens.spend_one(now_s):
        return
    build = _ANSWERS.get(type(message).id)
    if build is not None:
        answer = build(message, message.get_srcSystem(), message.get_srcComponent())
        context.send(peer, answer, Priority.URGENT)
    systems = peer.transport.options.systems
    stranger = systems is not None and message.get_srcSystem() not in systems
    reason = f"system {message.get_srcSystem()} may not command here" if stranger else "not signed"
    context.send_text_limited(peer, Severity.WARNING, f"{type(message).msgname} refused: {reason}", now_s)


def _command(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_command_ack_message(message.command, _DENIED, 0, 0, system, component)


def _set_mode(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - one of a table
    return mavlink.MAVLink_command_ack_message(mavlink.MAVLINK_MSG_ID_SET_MODE, _DENIED, 0, 0, system, component)


def _parameter(message: Message, system: int, component: int) -> Message:
    name, error = encode_text(message.param_id, 16), mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
    return mavlink.MAVLink_param_error_message(system, component, name, -1, error)


def _extended(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - one of a table
    name, kind = encode_text(message.param_id, 16), message.param_type
    return mavlink.MAVLink_param_ext_ack_message(name, b"", kind, mavlink.PARAM_ACK_FAILED)


def _mission(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(system, component, mavlink.MAV_MISSION_DENIED, message.mission_type)


def _file(message: Message, system: int, component: int) -> Message:
    payload = bytes(message.payload)
    sequence = (int.from_bytes(payload[:2], "little") + 1) & 0xFFFF
    head = (*sequence.to_bytes(2, "little"), payload[2], _NAK, 1, payload[3], 0, 0, *bytes(4), _FAIL_PROTECTED)
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
