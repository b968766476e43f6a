"""`rambler-hil serve-json`: connect ArduPilot's simulated autopilots to the simulated ship and evaluate their runs."""

from __future__ import annotations

import argparse
import contextlib
import math
import socket
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from firmware_py.common.angles import radians
from hil.cli.run_end import report_at_end
from hil.cli.sea_arguments import (
    RUNS,
    SCENARIO_NAMES,
    add_sea_arguments,
    goals_of,
    hide_from_git,
    sea_of,
    seconds_of,
    vehicle_of,
)
from hil.errors import UsageError
from hil.sim import run_directory
from hil.sim.json_ship import ActiveAutopilot, JsonShip, PacketError, read_packet
from hil.sim.logbook import RunOptions, recorded_run
from hil.sim.signals import interruptible
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S

ADDRESS, PORT = "127.0.0.1", 9002
DEFAULT_GOALS, DEFAULT_SECONDS, MAX_SECONDS = "0:0,120:60,720:-90", 1320.0, 1e7
SERVO_NUMBERS = range(1, 17)
TRAVEL_RANGE_DEG = (1.0, 45.0)
TIMEOUT_S = 60.0
POLL_S = 0.5
ROUNDING_S = 1e-6  # the simulated time is a sum of frames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("scenario", metavar="SCENARIO", help=SCENARIO_NAMES)
    add_sea_arguments(parser)
    parser.add_argument(
        "--seconds", type=float, metavar="N", default=DEFAULT_SECONDS, help="simulated length of the run (default 1320)"
    )
    parser.add_argument(
        "--goal",
        metavar="T:DEG,...",
        default=DEFAULT_GOALS,
        help="headings for the score, in degrees true by time in seconds; the operator sets them at these times"
        f' (default "{DEFAULT_GOALS}")',
    )
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="N", help=f"UDP port on {ADDRESS}, 0 for any (default {PORT})"
    )
    parser.add_argument("--steering", type=int, default=1, metavar="N", help="servo output for steering (default 1)")
    parser.add_argument(
        "--travel", type=float, default=30.0, metavar="DEG", help="rudder angle at 1900 us, to starboard (default 30)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (default runs/json-SCENARIO-SEED)")


def run(arguments: argparse.Namespace) -> int:
    """Serve until the end of the run, a timeout or Ctrl-C; write summary and page."""
    options = _read_options(arguments)
    if arguments.steering not in SERVO_NUMBERS or not TRAVEL_RANGE_DEG[0] <= arguments.travel <= TRAVEL_RANGE_DEG[1]:
        raise UsageError("--steering must be 1 to 16, --travel 1 to 45 degrees")
    with (
        contextlib.suppress(KeyboardInterrupt),
        closing(_open_listener(arguments.port)) as listener,
        run_directory.locked_directory(options.out),
        interruptible(),
        report_at_end(options.out),
        recorded_run(options, START_UTC_S) as book,
    ):
        print(
            f"waiting on udp {ADDRESS}:{listener.getsockname()[1]}; start the autopilot with --model json:{ADDRESS} and"
            f" --home {START_LATITUDE_DEG:g},{START_LONGITUDE_DEG:g},0,0",
            flush=True,
        )
        ship = JsonShip(book.world, servo=arguments.steering, travel_rad=radians(arguments.travel))
        book.wall_s = _serve(listener, ship, options.seconds, book.begin)
    return 0


def _read_options(arguments: argparse.Namespace) -> RunOptions:
    scenario = sea_of(arguments)
    out = arguments.out
    if out is None:
        out = RUNS / f"json-{scenario.name}-{arguments.seed}"
        hide_from_git(RUNS)
    return RunOptions(
        scenario=scenario,
        seconds=seconds_of(arguments.seconds, MAX_SECONDS),
        out=out,
        speed=math.inf,
        seed=arguments.seed,
        goals=goals_of(arguments.goal),
        vehicle=vehicle_of(arguments),
    )


def _open_listener(port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listener.bind((ADDRESS, port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise UsageError(f"--port {port}: {getattr(error, 'strerror', None) or error}; give another") from None
    listener.settimeout(POLL_S)
    return listener


def _serve(listener: socket.socket, ship: JsonShip, end_s: float, begin: Callable[[], None]) -> float | None:
    """Reply to packets until the end of the run or a timeout; report each kind of invalid packet once.

    Return the time from the first to the last packet, None without packets.
    """
    reported_errors: set[str] = set()
    autopilot = ActiveAutopilot()
    first_packet_s = last_packet_s = None
    while ship.now_s < end_s - ROUNDING_S:
        try:
            data, address = listener.recvfrom(2048)
        except TimeoutError:
            if last_packet_s is not None and time.monotonic() - last_packet_s > TIMEOUT_S:
                print(f"no packet from the autopilot for {TIMEOUT_S:g} s: end of the run", file=sys.stderr)
                break
            continue
        try:
            packet, now_s = read_packet(data), time.monotonic()
            is_new = autopilot.receive(address, now_s)
        except PacketError as error:
            if str(error) not in reported_errors and len(reported_errors) < 10:
                reported_errors.add(str(error))
                print(f"rambler-hil: {error}", file=sys.stderr)
            continue
        if is_new:
            print(f"autopilot at {address[0]}:{address[1]}", flush=True)
        if first_packet_s is None:
            first_packet_s = now_s
            begin()
        last_packet_s = now_s
        listener.sendto(ship.reply(packet), address)
    return None if first_packet_s is None or last_packet_s is None else last_packet_s - first_packet_s
