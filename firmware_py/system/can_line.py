"""Read-only lines of a CAN bus: a network interface of Linux (SocketCAN), or an adapter that python-can supports."""

from __future__ import annotations

import re
import socket
import struct
from contextlib import suppress
from typing import Any

from firmware_py.system.network_line import NetworkLine
from firmware_py.system.serial_port import MAX_READ_BYTES, PortError

FRAME_BYTES = 16
MAX_FRAMES = MAX_READ_BYTES // FRAME_BYTES  # per read
MAX_REASON_LENGTH = 80  # of an adapter's error in a text
_FRAME = struct.Struct("=IB3x8s")  # struct can_frame of linux/can.h: identifier, length, data
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000


class CanLine(NetworkLine):
    """A CAN interface of the kernel, `can:can0`; `read` returns frames of 16 bytes (struct can_frame).

    The kernel receives frames by itself; Python's socket module reads them.
    """

    name_format = "can:INTERFACE, as in can:can0, or can:ADAPTER:CHANNEL with the names of python-can"

    def open(self) -> None:
        """Open the socket; raises PortError with the remedy."""
        interface = self.name.partition(":")[2]
        try:
            client = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
        except OSError as error:
            raise PortError(f"port {self.name}: {_reason_of(error)}; load the kernel modules can and can_raw") from None
        try:
            client.bind((interface,))
        except (OSError, UnicodeError, ValueError) as error:
            client.close()
            raise PortError(
                f"port {self.name}: {_reason_of(error)}; start it with ip link set NAME up type can bitrate 250000"
            ) from None
        self._socket = client
        self.openings += 1

    def read(self) -> bytes:
        """Return the pending frames, at most MAX_FRAMES; close an interface that has failed."""
        frames: list[bytes] = []
        for _ in range(MAX_FRAMES if self._socket is not None else 0):
            try:
                frame = self._socket.recv(FRAME_BYTES)  # type: ignore[union-attr]
            except BlockingIOError:
                break
            except OSError:
                self.close()
                break
            if len(frame) == FRAME_BYTES:
                frames.append(frame)
        return b"".join(frames)


class CanAdapterLine(NetworkLine):
    """An adapter by python-can (extra `can`), `can:slcan:/dev/ttyACM0`; `read` returns frames as CanLine does.

    python-can is imported when the line is opened. An adapter without a descriptor is read once a tick.
    """

    name_format = CanLine.name_format

    def __init__(self, name: str) -> None:
        """Store the names; `open` or `reopen` opens the adapter."""
        super().__init__(name)
        self._bus: Any = None

    @property
    def connected(self) -> bool:
        """Whether the adapter is open."""
        return self._bus is not None

    def fileno(self) -> int:
        """Return the descriptor, or -1 without one."""
        if self._bus is not None:
            with suppress(Exception):  # adapters without a descriptor raise errors of several kinds
                return int(self._bus.fileno())
        return -1

    def open(self) -> None:
        """Open the adapter at the bit rate of NMEA 2000; raises PortError with the remedy."""
        try:
            import can  # noqa: PLC0415 - only for a boat with such an adapter
        except ImportError:
            raise PortError(f"port {self.name}: needs python-can; install rambler-autopilot[can]") from None
        _, interface, channel = self.name.split(":", 2)
        try:
            self._bus = can.Bus(interface=interface, channel=channel, bitrate=250_000)
        except Exception as error:  # noqa: BLE001 - adapters raise errors of several kinds
            reason = re.sub(r"\[Errno \d+\] ", "", str(error))[:MAX_REASON_LENGTH].strip(" :;.")
            raise PortError(f"port {self.name}: {reason}; plug the adapter in, or write {self.name_format}") from None
        self.openings += 1

    def reopen(self, now_s: float) -> str:
        """Try to open a missing adapter, at most once a second; return an empty report."""
        return "" if self.connected else super().reopen(now_s)

    def read(self) -> bytes:
        """Return the pending frames, at most MAX_FRAMES; close an adapter that has failed."""
        frames: list[bytes] = []
        for _ in range(MAX_FRAMES if self._bus is not None else 0):
            try:
                message = self._bus.recv(0.0)
            except Exception:  # noqa: BLE001 - adapters raise errors of several kinds
                self.close()
                break
            if message is None:
                break
            if message.dlc <= 8 and not message.is_fd:
                flags = (
                    (_EXTENDED if message.is_extended_id else 0)
                    | (_REMOTE if message.is_remote_frame else 0)
                    | (_ERROR if message.is_error_frame else 0)
                )
                data = bytes(message.data)[:8]
                frames.append(_FRAME.pack(message.arbitration_id | flags, len(data), data))
        return b"".join(frames)

    def close(self) -> None:
        """Close the adapter."""
        if self._bus is not None:
            with suppress(Exception):  # the adapter was unplugged
                self._bus.shutdown()
        self._bus = None


def can_line(name: str) -> CanLine | CanAdapterLine:
    """Return the line of a port: an interface of the kernel, or an adapter with a channel."""
    return CanAdapterLine(name) if name.count(":") > 1 else CanLine(name)


def _reason_of(error: Exception) -> str:
    return (error.strerror or str(error)).lower() if isinstance(error, OSError) else "no such interface"
