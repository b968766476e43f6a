"""`rambler-hil board`: the emulated devices of a boat on ports of their own, for any autopilot."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from msgspec.structs import replace

from firmware_py.common.angles import compass_degrees, degrees
from hil.cli.run_end import report_at_end
from hil.cli.sea_arguments import (
    SCENARIO_NAMES,
    adapters_of,
    add_adapter_arguments,
    add_sea_arguments,
    goals_of,
    sea_of,
    seconds_of,
    vehicle_of,
)
from hil.devices.serial_line import SerialLine
from hil.errors import UsageError
from hil.sim.adapters import open_adapters
from hil.sim.board import Board
from hil.sim.device_factory import make_emulators
from hil.sim.logbook import RunOptions, recorded_run
from hil.sim.realtime import RealTimeServer
from hil.sim.run_directory import VEHICLE_NAME, locked_directory
from hil.sim.signals import interruptible, stop_signal_handler
from hil.sim.vehicle_file import file_text

DEFAULT_SEA = "sea"
DEFAULT_LINK = "udpin:127.0.0.1:14550"
MAX_SECONDS = 1e7
STATE_NAME = "boat"  # suggested state directory of the autopilot, which this command never removes
REPORT_S = 10.0
POLL_S = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("directory", metavar="DIR", type=Path, help="directory for the ports and a vehicle file")
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default=DEFAULT_SEA, help=SCENARIO_NAMES)
    add_sea_arguments(parser)
    parser.add_argument("--seconds", type=float, metavar="N", help="length of the run (default: until Ctrl-C)")
    parser.add_argument(
        "--goal",
        metavar="T:DEG,...",
        help="headings for the score, in degrees true by time in seconds; the operator sets them at these times",
    )
    add_adapter_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Serve the devices until the end and print the state of the boat at intervals; write summary and page."""
    options = _read_options(arguments)
    directory = options.out
    with ExitStack() as stack:
        stack.enter_context(contextlib.suppress(KeyboardInterrupt))
        stack.enter_context(interruptible())
        stack.enter_context(locked_directory(directory))
        stack.enter_context(report_at_end(directory))
        book = stack.enter_context(recorded_run(options, time.time()))
        devices = make_emulators(book.world, options.vehicle, options.seed)
        lines = stack.enter_context(open_adapters(adapters_of(arguments), devices, options.vehicle))
        try:
            board = stack.enter_context(Board(book.world, devices, directory.absolute(), wired=lines))
            (directory / VEHICLE_NAME).write_text(file_text(options.vehicle, board.paths(), {}), encoding="utf-8")
        except OSError as error:
            raise UsageError(f"directory {directory}: {error.strerror}; give another") from None
        book.begin()
        _print_ports(directory, board, lines)
        book.wall_s = _serve(board, options.seconds, stack.enter_context(stop_signal_handler()))
    return 0


def _read_options(arguments: argparse.Namespace) -> RunOptions:
    vehicle = vehicle_of(arguments)
    if not vehicle.link_urls:
        vehicle = replace(vehicle, link_urls=(DEFAULT_LINK,))
    return RunOptions(
        scenario=sea_of(arguments),
        seconds=MAX_SECONDS if arguments.seconds is None else seconds_of(arguments.seconds, MAX_SECONDS),
        out=arguments.directory,
        speed=None,
        seed=arguments.seed,
        goals=goals_of(arguments.goal),
        vehicle=vehicle,
        play=True,
    )


def _print_ports(directory: Path, board: Board, lines: Mapping[str, SerialLine]) -> None:
    for name, path in board.paths().items():
        print(f"{name}: {'on the adapter' if name in lines else path}")
    vehicle_path = directory / VEHICLE_NAME
    run_words = f"rambler run {vehicle_path} --state {directory / STATE_NAME}"
    print(f"next:  rambler listen {vehicle_path}   rambler check {vehicle_path}   {run_words}")
    print("Ctrl-C ends the run", flush=True)


def _serve(board: Board, end_s: float, is_stopped: Callable[[], bool]) -> float:
    """Serve until the end or a signal; return the duration."""
    server, world = RealTimeServer(board), board.world
    report_s = 0.0
    while (now_s := server.now_s()) < end_s and not is_stopped():
        server.serve(min(end_s, now_s + POLL_S))
        if now_s >= report_s:
            report_s = now_s + REPORT_S
            print(
                f"{now_s:8.0f} s  heading {round(compass_degrees(world.heading_low_rad())) % 360:03d} deg"
                f"  rudder {degrees(world.rudder_rad()):+5.1f} deg  latitude {world.latitude_deg():.5f} deg"
                f"  longitude {world.longitude_deg():.5f} deg",
                flush=True,
            )
    return server.now_s()
