"""Emulated devices on real serial adapters, wired to a float computer under test."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from firmware_py.vehicle import Vehicle
from hil.devices.emulator import Device, Emulator
from hil.devices.network_line import NetworkLine, NetworkLineError
from hil.devices.serial_line import SerialLine, SerialLineError
from hil.errors import HilError, UsageError
from hil.sim.board import Board, Line
from hil.sim.device_factory import POSITION, make_emulators
from hil.sim.display import Banner, make_display
from hil.sim.ground_station import GroundStation, disarm
from hil.sim.logbook import RunOptions, recorded_run
from hil.sim.realtime import RealTimeServer
from hil.sim.run_file import OrderRecord
from hil.sim.signals import interruptible

# Option and name of the device behind the adapter.
ADAPTERS = {"compass_port": "compass", "servo_port": "rudder", "position_port": "position"}
POLL_S = 0.03
CHECK_S = 1.0  # interval of checks for a failure
DISARM_S = 2.0  # time for the order to disarm after the run


@contextmanager
def open_adapters(
    paths: Mapping[str, str], devices: Mapping[str, Device], vehicle: Vehicle
) -> Iterator[dict[str, SerialLine]]:
    """Open the adapter of each device; raise UsageError if that fails.

    The transfer time is then that of the real line, not of the emulated transmitter.
    """
    if "rudder" in paths and vehicle.rudder.driver == "pwm":
        raise UsageError("--servo-port: a servo on a PWM output has no serial line; connect the servo itself")
    bauds = {"compass": vehicle.compass.baud, "rudder": vehicle.rudder.baud, "position": POSITION.baud}
    with ExitStack() as stack:
        lines = {}
        for name, path in paths.items():
            option = next(option.replace("_", "-") for option, device in ADAPTERS.items() if device == name)
            if name not in devices:
                raise UsageError(f"--{option} {path}: the {name} is on the port of the compass; omit this option")
            try:
                lines[name] = stack.enter_context(contextlib.closing(SerialLine(path, bauds[name])))
            except SerialLineError as error:
                raise UsageError(f"--{option} {error}") from None
            devices[name].transmitter.is_on_real_line = True
        yield lines


def run(options: RunOptions, paths: Mapping[str, str], url: str) -> None:
    """Make a run with an autopilot on another computer: devices on local adapters, commands over `url`.

    The output directory contains the files of a run, except those that are on the float computer. The run ends with
    the boat disarmed. Raises HilError if it fails.
    """
    with recorded_run(options, time.time()) as book, interruptible(), ExitStack() as stack:
        station = GroundStation(options.goals, options.mode, shared=True, sends_first=True)
        devices = make_emulators(book.world, options.vehicle, options.seed)
        lines: dict[str, Line] = {**stack.enter_context(open_adapters(paths, devices, options.vehicle))}
        try:
            lines["link"] = stack.enter_context(contextlib.closing(NetworkLine(url)))
        except NetworkLineError as error:
            raise UsageError(f"--remote {error}") from None
        emulated: dict[str, Emulator] = {**{name: devices[name] for name in paths}, "link": station}
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rambler-")))
        board = stack.enter_context(Board(book.world, emulated, directory, wired=lines))
        book.begin()
        title = f"rambler-hil run {options.scenario.name}, seed {options.seed}, with the autopilot at {url}"
        display = stack.enter_context(
            make_display(Banner(title, options.seconds, (url,), lockstep=False), board.world, station)
        )
        server, next_check_s = RealTimeServer(board), 0.0
        try:
            while board.world.now_s < options.seconds:
                display.update(server.serve(min(options.seconds, server.now_s() + POLL_S)))
                if server.now_s() >= next_check_s:
                    next_check_s = server.now_s() + CHECK_S
                    if failure := station.failure(board.world.now_s):
                        raise HilError(failure)
            book.wall_s = server.now_s()
        finally:
            station.order(disarm(server.now_s()), server.now_s())
            end_s = server.now_s() + DISARM_S
            while server.now_s() < end_s:
                server.serve(server.now_s() + POLL_S)
            book.orders, book.arrivals = tuple(map(OrderRecord.of, station.orders)), tuple(station.reached)
        if failure_text := station.final_failure():
            raise HilError(failure_text)
