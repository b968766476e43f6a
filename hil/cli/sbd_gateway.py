"""`rambler-hil sbd-gateway`: the Iridium messages of a boat as a MAVLink endpoint for a ground station."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from hil.devices.message_post import FROM_BOAT, IMEI_DIGITS, TO_BOAT, MessagePost
from hil.errors import UsageError
from hil.shore.gateway import Gateway
from hil.shore.web import Inbox, Sender
from hil.sim.signals import stop_signal_handler

DEFAULT_STATION = "udpout:127.0.0.1:14550"
_POLL_DIRECTORY_S = 0.5
_POLL_STATION_S = 0.02
_MAX_TRIES, _RETRY_S = 20, 30.0
_MAX_COMMANDS = 50  # of a station at once


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "directory",
        metavar="DIR",
        type=Path,
        help="messages as files IMEI_NUMBER.sbd: from the boat in DIR/from-boat, to the boat in DIR/to-boat",
    )
    parser.add_argument(
        "--station",
        metavar="URL",
        default=DEFAULT_STATION,
        help=f"link of the ground station: udpout, udpin, tcp (out) or tcpin:HOST:PORT (default {DEFAULT_STATION})",
    )
    parser.add_argument("--imei", help="15 digits of the boat's modem (default: that of the first message)")
    parser.add_argument(
        "--key-file",
        metavar="FILE",
        type=Path,
        help="the boat's key: a file with the passphrase in its first line; it authenticates commands to the boat",
    )
    parser.add_argument("--hex", action="store_true", help="the first line is the key itself, 64 hexadecimal digits")
    parser.add_argument(
        "--http",
        metavar="HOST:PORT",
        help="also receive messages of the boat by HTTP POST, in the format of the RockBLOCK service",
    )
    parser.add_argument(
        "--send-url", metavar="URL", help="send messages to the boat by HTTP POST, in the RockBLOCK format"
    )
    parser.add_argument(
        "--account-file",
        metavar="FILE",
        type=Path,
        help="for --send-url: a file with the user in its first line and the password in its second",
    )


class StationLink:
    """Link to a ground station by pymavlink; messages to it are signed if there is a key."""

    def __init__(self, url: str, key: bytes | None) -> None:
        """Open the link; raise UsageError if that fails."""
        os.environ["MAVLINK20"] = "1"  # read by mavutil
        from pymavlink import mavutil  # noqa: PLC0415 - slow to import, and it reads the environment

        try:
            self._link = mavutil.mavlink_connection(url, dialect="common", source_system=1, source_component=1)
        except (OSError, ValueError, IndexError) as error:
            raise UsageError(f"--station {url}: {error}; use udpout:HOST:PORT, udpin, tcp or tcpin") from None
        self._link.mav.robust_parsing = True
        if key is not None:
            # Accepted commands get the key of the boat, so commands from other computers must be signed.
            is_local = ":127." in url
            self._link.setup_signing(key, sign_outgoing=True, allow_unsigned_callback=lambda *_: is_local)

    def send(self, message: Any, system: int, component: int) -> None:
        """Send a message with this system and component id."""
        self._link.mav.srcSystem, self._link.mav.srcComponent = system, component
        with contextlib.suppress(OSError):
            self._link.mav.send(message)

    def receive(self) -> Any | None:
        """Return a message of the station, or None."""
        try:
            message = self._link.recv_msg()
        except OSError:
            return None
        return None if message is None or message.get_type() == "BAD_DATA" else message

    def close(self) -> None:
        """Close the link."""
        self._link.close()


class _Outbox:
    """Messages to the boat, to a directory or, with retries in the background, to the service of the provider."""

    def __init__(self, post: MessagePost, sender: Sender | None) -> None:
        self._post, self._sender = post, sender
        self._thread = ThreadPoolExecutor(1)
        self._number = int(time.time()) % 1_000_000
        self.problems: list[str] = []

    def deliver(self, imei: str, message: bytes) -> None:
        if self._sender is not None:
            self._thread.submit(self._send, self._sender, imei, message)
            return
        self._number = (self._number + 1) % 1_000_000
        try:
            self._post.put(imei, self._number, message)
        except OSError as error:
            self.problems.append(f"Message not sent: {self._post.directory}: {error.strerror}")

    def _send(self, sender: Sender, imei: str, message: bytes) -> None:
        for _ in range(_MAX_TRIES):
            try:
                refusal = sender.send(imei, message)
            except (OSError, ValueError) as error:
                self.problems.append(f"Message not sent, retrying: {error}")
                time.sleep(_RETRY_S)
                continue
            if refusal:
                self.problems.append(f"Message rejected by the provider: {refusal}")
            return
        self.problems.append(f"Message not sent after {_MAX_TRIES} tries: dropped")

    def close(self) -> None:
        self._thread.shutdown(wait=False, cancel_futures=True)


def run(arguments: argparse.Namespace) -> int:
    """Exchange messages until a signal."""
    key = _key_of(arguments)
    imei = arguments.imei or ""
    if imei and not (len(imei) == IMEI_DIGITS and imei.isascii() and imei.isdigit()):
        raise UsageError(f"--imei {imei[:30]}: give the 15 digits of the modem")
    try:
        from_boat, to_boat = MessagePost(arguments.directory, FROM_BOAT), MessagePost(arguments.directory, TO_BOAT)
    except OSError as error:
        raise UsageError(f"directory {arguments.directory}: {error.strerror}; give another") from None
    with contextlib.ExitStack() as stack:
        is_stopped = stack.enter_context(stop_signal_handler())
        station = stack.enter_context(contextlib.closing(StationLink(arguments.station, key)))
        outbox = stack.enter_context(contextlib.closing(_Outbox(to_boat, _sender_of(arguments))))
        if arguments.http is not None:
            web = stack.enter_context(contextlib.closing(Inbox(_address_of(arguments.http), from_boat)))
            print(f"receiving messages on port {web.port}")
        gateway = Gateway(station, outbox.deliver, _log, key=key, imei=imei)
        print(f"{arguments.directory}: messages of {imei or 'any boat'}; station {arguments.station}", flush=True)
        next_poll_s, has_station = 0.0, False
        while not is_stopped():
            now_s = time.monotonic()
            if now_s >= next_poll_s:
                next_poll_s = now_s + _POLL_DIRECTORY_S
                for sender_imei, _, content in from_boat.take():
                    _call_safely(gateway, partial(gateway.receive_message, sender_imei, content))
                problems = [*from_boat.problems, *outbox.problems]
                from_boat.problems.clear()
                outbox.problems.clear()
                for problem in problems:
                    gateway.report_problem(problem)
            for _ in range(_MAX_COMMANDS):
                message = _call_safely(gateway, station.receive)
                if message is None:
                    break
                if not has_station:
                    has_station = True
                    _call_safely(gateway, gateway.send_last_report)
                _call_safely(gateway, partial(gateway.receive_command, message, now_s, time.time()))
            time.sleep(_POLL_STATION_S)
    return 0


def _call_safely(gateway: Gateway, function: Callable[[], Any]) -> Any:
    """Return the result of `function`; report an error, so that the next message is still processed."""
    try:
        return function()
    except Exception as error:  # noqa: BLE001 - messages come from outside
        gateway.report_problem(f"Message skipped: {type(error).__name__}: {error}")
        return None


def _log(text: str) -> None:
    print(f"{time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime())} {text}", flush=True)


def _lines_of(path: Path, option: str) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{option} {path}: {getattr(error, 'strerror', None) or 'not a text file'}; give another file"
        ) from None


def _key_of(arguments: argparse.Namespace) -> bytes | None:
    if arguments.key_file is None:
        print("no --key-file: commands have no key; a boat with a key rejects them", file=sys.stderr)
        return None
    lines = _lines_of(arguments.key_file, "--key-file")
    first_line = lines[0] if lines else ""
    if not arguments.hex:
        if not first_line:
            raise UsageError(f"--key-file {arguments.key_file}: empty; write the passphrase into its first line")
        return hashlib.sha256(first_line.encode()).digest()
    try:
        key = bytes.fromhex(first_line)
    except ValueError:
        key = b""
    if len(key) != 32:
        raise UsageError(f"--key-file {arguments.key_file}: with --hex the first line must be 64 hexadecimal digits")
    return key


def _sender_of(arguments: argparse.Namespace) -> Sender | None:
    if arguments.send_url is None:
        return None
    if not arguments.send_url.startswith(("http://", "https://")):
        raise UsageError(f"--send-url {arguments.send_url[:60]}: must begin with http:// or https://")
    lines = _lines_of(arguments.account_file, "--account-file") if arguments.account_file is not None else []
    user, password = (*lines, "", "")[:2]
    if not (user and password):
        raise UsageError("--send-url: give --account-file, a file with two lines, user and password")
    return Sender(arguments.send_url, user, password)


def _address_of(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 <= int(port[:6]) <= 65535:
        raise UsageError(f"--http {text[:60]}: write HOST:PORT, as in 127.0.0.1:8080")
    return host, int(port)
