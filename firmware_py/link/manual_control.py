"""The operator's stick: MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.intents import ManualRudder
from firmware_py.common.mode_table import MODES, BaseMode
from firmware_py.common.records import Severity
from firmware_py.link.context import Handler, LinkContext, within
from firmware_py.link.peers import Peer
from firmware_py.link.telemetry.context_fields import INT16_MAX, UINT16_MAX
from firmware_py.link.wire.dialect import Message

_FULL_STICK = 1000
_CENTRE_US, _FULL_US = 1500, 500
_RELEASE, _IGNORE = 0, UINT16_MAX
_OTHER_CHANNELS = tuple(f"chan{number}_raw" for number in range(2, 9))
_CHANNEL_1 = "channel 1 is the rudder in MANUAL, the heading in STEERING"


class ManualControl:
    """Turns stick messages into rudder deflections."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._idle = ""  # why the override does nothing, as it was told last

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {69: self._stick, 70: self._override}

    def _stick(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take the roll axis y, or the yaw axis r where y is said to be invalid."""
        axis = message.r if message.y == INT16_MAX else message.y
        if axis == INT16_MAX:
            return
        valid = within(axis, -_FULL_STICK, _FULL_STICK)
        intent = ManualRudder(axis / _FULL_STICK) if valid else "the stick is not within -1000 to 1000"
        self._context.request_or_warn(peer, message, intent, now_s)

    def _override(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take channel 1: 1000 to 2000 us, 0 releases it; that an override does nothing is told once."""
        pulse_us, held = message.chan1_raw, message.chan1_raw not in (_RELEASE, _IGNORE)
        if held and not within(pulse_us, _CENTRE_US - _FULL_US, _CENTRE_US + _FULL_US):
            self._context.request_or_warn(peer, message, "channel 1 is not within 1000 to 2000", now_s)
            return
        self._tell_idle(peer, message, now_s)
        if pulse_us == _IGNORE:
            return
        self._context.override_us = (now_s, pulse_us) if held else None
        deflection = (pulse_us - _CENTRE_US) / _FULL_US if held else None
        self._context.request_or_warn(peer, message, ManualRudder(deflection), now_s)

    def _tell_idle(self, peer: Peer, message: Message, now_s: float) -> None:
        idle = self._idle_override(message)
        if idle and idle != self._idle:
            self._context.send_text_limited(peer, Severity.NOTICE, idle, now_s)
        self._idle = idle

    def _idle_override(self, message: Message) -> str:
        """Say why an override does nothing; empty when it does something, or only releases."""
        boat = self._context.snapshot
        if message.chan1_raw not in (_RELEASE, _IGNORE):
            if boat is not None and not boat.armed:
                return "RC override does nothing: disarmed"
            if boat is not None and not MODES[boat.mode].base_mode & BaseMode.MANUAL_INPUT:
                return f"RC override does nothing in {boat.mode.name}: {_CHANNEL_1}"
            return ""
        if any(getattr(message, name) not in (_RELEASE, _IGNORE) for name in _OTHER_CHANNELS):
            return f"RC override does nothing: {_CHANNEL_1}"
        return ""
