"""Services of one or two messages: time, radio status, console, battery of a companion, signing key, refusals."""

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

_MAX_STORED_PINGS = 32
_MAX_UTC_S = 1e11  # a later UTC of a ground station is ignored

_SERIAL_CONTROL = 126
_REPLY_FLAG = mavlink.SERIAL_CONTROL_FLAG_REPLY
_SHELL_TEXT = b"no shell over MAVLink; log in by ssh\r\n"
_SHELL_DATA = _SHELL_TEXT.ljust(70, b"\0")

BATTERY_STATUS = 147
MIN_BATTERY_INTERVAL_S = 0.5

_UNTRUSTED = "SETUP_SIGNING refused: set the key by `rambler key set`, or over a link with ?trusted=1 in its URL"

_DENIED = mavlink.MAV_RESULT_DENIED
_NAK, _FAIL_PROTECTED = 129, 9  # of file transfer: opcode, error code FileProtected
_PAYLOAD_BYTES = 251  # of file transfer


class Timesync:
    """Replies to PING and TIMESYNC, and offers the UTC of stations to the clock."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context
        self._latest_pings: OrderedDict[tuple[Peer, int, int], tuple[int, int]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handlers by message number."""
        return {
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_PING: self._ping,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
        }

    def _ping(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Reply to a broadcast ping, and once to a ping that is addressed to the boat.

        By the specification an addressed ping is a reply, but some stations send it as a request. It gets one reply
        only, since two systems that reply to each ping would never stop.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.target_system:
            requester, ping = (peer, *sender), (message.time_usec, message.seq)
            if self._latest_pings.get(requester) == ping:
                return
            keep_latest(self._latest_pings, requester, ping, _MAX_STORED_PINGS)
        reply = mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender)
        self._context.send(peer, reply, Priority.URGENT)

    def _timesync(self, peer: Peer, message: Message, now_s: float) -> None:
        """Reply to a request with the time since start; ignore replies of other systems."""
        if message.tc1:
            return
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.mavlink_map[111](int(now_s * 1e9), message.ts1, sender, component)  # TIMESYNC
        self._context.send(peer, reply, Priority.URGENT)

    def _system_time(self, peer: Peer, message: Message, now_s: float) -> None:
        """Offer the UTC of a ground station to a clock that is clearly wrong (`CLK_SET`)."""
        utc_s = message.time_unix_usec * 1e-6
        offer = self._context.suppliers.offer_utc
        if offer is not None and peer.ground_station_s is not None and 0.0 < utc_s < _MAX_UTC_S:
            offer(utc_s, now_s)


def adapt_to_radio_status(peer: Peer, message: Message, now_s: float) -> None:
    """Limit the rate to what the radio modem in a serial line accepts."""
    peer.adapt_to_radio(message.txbuf, now_s)


class Shell:
    """Replies to the console of a ground station that there is no shell, since it would wait for a reply forever."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handlers by message number."""
        return {_SERIAL_CONTROL: self._reply}

    def _reply(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Reply to console input with one line; ignore replies."""
        if message.device == mavlink.SERIAL_CONTROL_DEV_SHELL and message.count and not message.flags & _REPLY_FLAG:
            make = mavlink.MAVLink_serial_control_message
            self._context.send(peer, make(message.device, _REPLY_FLAG, 0, 0, len(_SHELL_TEXT), _SHELL_DATA))


class CompanionBattery:
    """Receives BATTERY_STATUS of the first battery from the component PWR_COMPANION, and ignores others."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context
        self._sample_s = -math.inf  # time of the latest sample

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handlers by message number."""
        return {BATTERY_STATUS: self._battery}

    def _battery(self, peer: Peer, message: Message, now_s: float) -> None:
        """Use voltage, current and charge of the battery from the component PWR_COMPANION."""
        is_too_soon = now_s - self._sample_s < MIN_BATTERY_INTERVAL_S
        if message.id != 0 or not is_from_companion(self._context, message) or is_too_soon:
            return
        self._sample_s = now_s
        self._context.request_or_warn(peer, message, battery_report(message), now_s)


def is_from_companion(context: LinkContext, message: Message) -> bool:
    """Return whether the sender of a message is the component PWR_COMPANION."""
    companion = int(context.request_handler.parameters()["PWR_COMPANION"])
    return companion != 0 and (message.get_srcSystem(), message.get_srcComponent()) == (context.system, companion)


def battery_report(message: Message) -> ReportBattery:
    """Convert BATTERY_STATUS to a report; a discharge current is positive there and negative in the report."""
    millivolts = _known_cells(message.voltages, UINT16_MAX) + _known_cells(message.voltages_ext, 0)
    centiamperes, percent = message.current_battery, message.battery_remaining
    return ReportBattery(
        voltage_v=sum(millivolts) * 1e-3 if millivolts else None,
        current_a=None if centiamperes == -1 else -0.01 * centiamperes,
        charge=None if percent < 0 else 0.01 * percent,
        temperature_c=None if message.temperature == INT16_MAX else 0.01 * message.temperature,
    )


def _known_cells(cells: Sequence[int], unknown: int) -> list[int]:
    return [cell for cell in cells if cell != unknown]


class KeySetup:
    """Sets the signing key (SETUP_SIGNING), over a trusted link only. Key and timestamp of zero remove the key."""

    def __init__(self, context: LinkContext, signing: Signing, vault: Vault) -> None:
        """Store the context, the signing state and its storage."""
        self._context = context
        self._signing = signing
        self._vault = vault

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handlers by message number."""
        return {SETUP_SIGNING: self._set_key}

    def _set_key(self, peer: Peer, message: Message, now_s: float) -> None:
        if not peer.transport.options.trusted:
            self._context.send_text_limited(peer, Severity.WARNING, _UNTRUSTED, now_s)
            return
        key, timestamp = bytes(message.secret_key), message.initial_timestamp
        if not any(key) and timestamp == 0:
            self._signing.remove_key()
            notice = "Signing key removed"
        elif self._signing.set_key(key, timestamp):
            notice = "Signing key set"
        else:
            self._context.send_text_limited(
                peer, Severity.WARNING, "SETUP_SIGNING refused: no key, or no timestamp", now_s
            )
            return
        self._vault.when_stored(lambda is_stored: self._report(notice, is_stored=is_stored))

    def _report(self, notice: str, *, is_stored: bool) -> None:
        if is_stored:
            self._context.send_text_all(Severity.NOTICE, notice)
        else:
            self._context.send_text_all(Severity.ERROR, f"{notice}, but this could not be stored")
        self._context.flush_all()


def deny(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Send the refusal of a message without rights, as the reply of its protocol and as a text, at a limited rate."""
    if type(message).id == BATTERY_STATUS and not is_from_companion(context, message):
        return  # a broadcast, not a request to the boat
    if not peer.denial_tokens.spend_one(now_s):
        return
    build = _DENIALS.get(type(message).id)
    if build is not None:
        denial = build(message, message.get_srcSystem(), message.get_srcComponent())
        context.send(peer, denial, Priority.URGENT)
    systems = peer.transport.options.systems
    is_excluded = systems is not None and message.get_srcSystem() not in systems
    reason = f"system {message.get_srcSystem()} may not command here" if is_excluded else "not signed"
    context.send_text_limited(peer, Severity.WARNING, f"{type(message).msgname} refused: {reason}", now_s)


def _deny_command(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_command_ack_message(message.command, _DENIED, 0, 0, system, component)


def _deny_mode(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - a builder like the others
    return mavlink.MAVLink_command_ack_message(mavlink.MAVLINK_MSG_ID_SET_MODE, _DENIED, 0, 0, system, component)


def _deny_parameter(message: Message, system: int, component: int) -> Message:
    name, error = encode_text(message.param_id, 16), mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
    return mavlink.MAVLink_param_error_message(system, component, name, -1, error)


def _deny_extended(message: Message, system: int, component: int) -> Message:  # noqa: ARG001 - a builder like the others
    name, kind = encode_text(message.param_id, 16), message.param_type
    return mavlink.MAVLink_param_ext_ack_message(name, b"", kind, mavlink.PARAM_ACK_FAILED)


def _deny_mission(message: Message, system: int, component: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(system, component, mavlink.MAV_MISSION_DENIED, message.mission_type)


def _deny_file(message: Message, system: int, component: int) -> Message:
    request = bytes(message.payload)
    sequence = (int.from_bytes(request[:2], "little") + 1) & 0xFFFF
    # Sequence, session, opcode, size, requested opcode, end of burst, padding, offset, error code.
    header = (*sequence.to_bytes(2, "little"), request[2], _NAK, 1, request[3], 0, 0, *bytes(4), _FAIL_PROTECTED)
    payload = bytes(header).ljust(_PAYLOAD_BYTES, b"\0")
    return mavlink.MAVLink_file_transfer_protocol_message(0, system, component, payload)


_DENIALS: Mapping[int, Callable[[Message, int, int], Message]] = {
    11: _deny_mode,  # SET_MODE
    23: _deny_parameter,  # PARAM_SET
    38: _deny_mission,  # MISSION_WRITE_PARTIAL_LIST
    39: _deny_mission,  # MISSION_ITEM
    44: _deny_mission,  # MISSION_COUNT
    45: _deny_mission,  # MISSION_CLEAR_ALL
    73: _deny_mission,  # MISSION_ITEM_INT
    75: _deny_command,  # COMMAND_INT
    76: _deny_command,  # COMMAND_LONG
    110: _deny_file,  # FILE_TRANSFER_PROTOCOL
    323: _deny_extended,  # PARAM_EXT_SET
}
