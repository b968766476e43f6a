"""How soon a ground station is answered, beside a process that sends each datagram back."""

from __future__ import annotations

import os
import random
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from hil.bench.figure import Figure, Finding
from hil.bench.helper import background
from hil.bench.sea import Sea
from hil.bench.setting import Setting
from hil.bench.spread import Spread, spread
from hil.bench.station import Station
from hil.bench.steady import steady
from hil.errors import HilError

MILLISECONDS = 1e3
# Between two questions, so that they fall on all phases of the 0.1 s ticks.
GAP_S = (0.005, 0.03)
PATIENCE_S = 1.0
MOST_LOST = 0.02
MOST_MS = 1.0
PARAMETER = "POS_TIMEOUT_S"  # steers nothing in a heading run
VALUES = (5.0, 6.0)
GUIDED = 15
SEED = 1
STORINGS = 50
STORED_BYTES = 64

Question = tuple[Any, Callable[[Any], bool]]


def measure(setting: Setting) -> Finding:
    """Set a parameter and command a mode again and again, at random moments of the tick."""
    with Sea(setting.directory / "trips") as sea, steady():
        sea.listen(2.0)
        parameters = _ask(sea.station, setting.trips, parameter_question)
        commands = _ask(sea.station, setting.trips, command_question)
        frame = sea.station.pack(parameter_question(0)[0])
    with background("-m", "hil.bench.bare_echo", "udp") as (_, port), steady():
        bare = echo(int(port), frame, setting.trips)
    storing = spread(_store(setting.directory / "stored", STORINGS))
    low_ms, high_ms = (gap_s * MILLISECONDS for gap_s in GAP_S)
    storing_ms = storing.p50 * MILLISECONDS
    notes = (
        f"{parameters.count} and {commands.count} round trips on loopback UDP, {low_ms:g} to {high_ms:g} ms apart",
        "PARAM_SET is answered when the value is on disk; COMMAND_LONG is DO_SET_MODE",
        f"on this disk, {STORED_BYTES} bytes overwritten and forced down take p50 {storing_ms:.2f} ms",
        "bare: a Python process that sends each datagram back; for PARAM_SET, and what the disk takes besides",
    )
    return Finding("Round trips", figures_of(parameters, commands, bare, storing), notes)


def figures_of(parameters: Spread, commands: Spread, bare: Spread, storing: Spread) -> tuple[Figure, ...]:
    """Return the figures; the spreads are in seconds."""

    def figure(name: str, value_s: float, bare_s: float, peer: str, most: float | None = None) -> Figure:
        return Figure(name, "ms", value_s * MILLISECONDS, bare_s * MILLISECONDS, most=most, peer=peer)

    return (
        figure("PARAM_SET, p50", parameters.p50, bare.p50 + storing.p50, "ArduRover 14", MOST_MS),
        figure("PARAM_SET, p95", parameters.p95, bare.p95 + storing.p95, "ArduRover 26"),
        figure("COMMAND_LONG, p50", commands.p50, bare.p50, "ArduRover 11", MOST_MS),
        figure("COMMAND_LONG, p95", commands.p95, bare.p95, "ArduRover 22"),
    )


def parameter_question(index: int) -> Question:
    """Return the message that sets the parameter to the other value, and what answers it."""
    value = VALUES[index % 2]
    message = dialect.MAVLink_param_set_message(1, 1, PARAMETER.encode(), value, dialect.MAV_PARAM_TYPE_REAL32)

    def answers(reply: Any) -> bool:
        return bool(reply.get_type() == "PARAM_VALUE" and reply.param_id == PARAMETER and reply.param_value == value)

    return message, answers


def command_question(_index: int) -> Question:
    """Return the message that asks for mode GUIDED, and what acknowledges it."""
    number = dialect.MAV_CMD_DO_SET_MODE
    message = dialect.MAVLink_command_long_message(1, 1, number, 0, 1.0, float(GUIDED), 0, 0, 0, 0, 0)

    def answers(reply: Any) -> bool:
        return bool(reply.get_type() == "COMMAND_ACK" and reply.command == number)

    return message, answers


def _ask(station: Station, count: int, question: Callable[[int], Question]) -> Spread:
    chances = random.Random(SEED)
    taken_s = []
    for index in range(count):
        station.listen(chances.uniform(*GAP_S))
        message, answers = question(index)
        sent_s = station.send(station.pack(message))
        heard_s = station.await_message(PATIENCE_S, answers)
        if heard_s is not None:
            taken_s.append(heard_s - sent_s)
    if len(taken_s) < count * (1.0 - MOST_LOST):
        raise HilError(f"{count - len(taken_s)} of {count} questions were not answered within {PATIENCE_S:g} s")
    return spread(taken_s)


def echo(port: int, frame: bytes, count: int) -> Spread:
    """Return the round trips, in seconds, of a frame to a process that sends each datagram back."""
    chances = random.Random(SEED)
    taken_s = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.connect(("127.0.0.1", port))
        asker.settimeout(PATIENCE_S)
        for _ in range(count):
            time.sleep(chances.uniform(*GAP_S))
            sent_s = time.monotonic()
            asker.send(frame)
            asker.recv(len(frame))
            taken_s.append(time.monotonic() - sent_s)
    return spread(taken_s)


def _store(path: Path, count: int) -> list[float]:
    taken_s = []
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT)
    try:
        # The first time makes the file longer, which is another matter.
        for _ in range(count + 1):
            time.sleep(GAP_S[0])
            start_s = time.monotonic()
            os.pwrite(descriptor, os.urandom(STORED_BYTES), 0)
            os.fdatasync(descriptor)
            taken_s.append(time.monotonic() - start_s)
    finally:
        os.close(descriptor)
    return taken_s[1:]
