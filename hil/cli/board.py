"""`rambler-hil board`: the devices of a boat on ports of their own, for whatever is to read and steer them."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from firmware_py.common.angles import compass_degrees, degrees
from hil.cli.sea_arguments import (
    SCENARIO_NAMES,
    adapters_of,
    add_adapter_arguments,
    add_sea_arguments,
    sea_of,
    seconds_of,
    vehicle_of,
)
from hil.devices.serial_line import SerialLine
from hil.errors import UsageError
from hil.sim import run_file
from hil.sim.adapters import wired
from hil.sim.board import Board
from hil.sim.device_factory import emulators
from hil.sim.realtime import RealTimeServer
from hil.sim.run_directory import CAMPAIGN, TRUTH_FILE, VEHICLE_NAME, check_free, held
from hil.sim.signals import interruptible
from hil.sim.truth import TruthFile
from hil.sim.vehicle_file import file_text, model_of, mounting_of
from hil.sim.world import World, columns_beside

DEFAULT_SEA = "sea"
DEFAULT_LINK = "udpin:127.0.0.1:14550"
LONGEST_S = 1e7
TELL_S = 10.0
LOOK_S = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("directory", metavar="DIR", type=Path, help="where the ports and a vehicle file for them are")
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default=DEFAULT_SEA, help=SCENARIO_NAMES)
    add_sea_arguments(parser)
    parser.add_argument("--seconds", type=float, metavar="N", help="end after so long (default: when interrupted)")
    add_adapter_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Play the devices until the end, and say now and then what the boat does."""
    directory: Path = arguments.directory
    end_s = math.inf if arguments.seconds is None else seconds_of(arguments.seconds, LONGEST_S)
    scenario, vehicle = sea_of(arguments), vehicle_of(arguments)
    if not vehicle.link_urls:
        vehicle = replace(vehicle, link_urls=(DEFAULT_LINK,))
    with ExitStack() as stack:
        stack.enter_context(contextlib.suppress(KeyboardInterrupt))
        stack.enter_context(interruptible())
        stack.enter_context(held(directory))
        check_free(directory, (CAMPAIGN, run_file.NAME))
        try:
            truth = stack.enter_context(contextlib.closing(TruthFile(directory / TRUTH_FILE, columns_beside(scenario))))
            world = World(
                scenario, arguments.seed, model=model_of(vehicle), mounting=mounting_of(vehicle), truth=truth,
                start_utc_s=time.time(),
            )  # fmt: skip
            devices = emulators(world, vehicle, arguments.seed)
            lines = stack.enter_context(wired(adapters_of(arguments), devices, vehicle))
            board = stack.enter_context(Board(world, devices, directory.absolute(), wired=lines))
            (directory / VEHICLE_NAME).write_text(file_text(vehicle, board.paths(), {}), encoding="utf-8")
        except ValueError as error:
            raise UsageError(f"the vehicle file describes no ship: {error}") from None
        except OSError as error:
            raise UsageError(f"directory {directory}: {error.strerror}; give another") from None
        _introduce(directory, board, lines)
        _serve(board, end_s)
    print(f"what she did: {directory / TRUTH_FILE}")
    return 0


def _introduce(directory: Path, board: Board, lines: Mapping[str, SerialLine]) -> None:
    for name, path in board.paths().items():
        print(f"{name}: {'on the adapter' if name in lines else path}")
    file = directory / VEHICLE_NAME
    print(f"try:  rambler listen {file}   rambler check {file}   rambler run {file} --state {directory / 'state'}")
    print("Ctrl-C ends it", flush=True)


def _serve(board: Board, end_s: float) -> None:
    server, world = RealTimeServer(board), board.world
    told_s = 0.0
    while (now_s := server.now_s()) < end_s:
        server.serve(min(end_s, now_s + LOOK_S))
        if now_s >= told_s:
            told_s = now_s + TELL_S
            print(
                f"{now_s:8.0f} s  heading {round(compass_degrees(world.heading_low_rad())) % 360:03d}"
                f"  rudder {degrees(world.rudder_rad()):+5.1f}  latitude {world.latitude_deg():.5f}"
                f"  longitude {world.longitude_deg():.5f}",
                flush=True,
            )
