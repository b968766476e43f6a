"""`rambler run`: the autopilot."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import NoReturn

from firmware_py import __version__
from firmware_py.assemble.supervision import Supervision
from firmware_py.assemble.wiring import Assembly, Options, assemble
from firmware_py.cli.errors import print_error
from firmware_py.core.liveness import StuckError
from firmware_py.files.writing import exact_modes
from firmware_py.link.wire.urls import LinkError
from firmware_py.link.wire.worker import THREAD_NAME as FILES_THREAD
from firmware_py.loop import run as run_loop
from firmware_py.system import realtime
from firmware_py.system.clock import ClockError
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.endings import STUCK_EXIT_CODE
from firmware_py.system.serial_port import PortError
from firmware_py.system.service_manager import ServiceManager, runtime_directory
from firmware_py.system.signals import Signals
from firmware_py.system.watchdogs import WatchdogError
from firmware_py.vehicle import VehicleError, load

RETRY_DELAY_S = 5.0  # from a failed start to the exit, under a service manager
MAX_CLOSE_S = 2.0  # for closing everything that is not stuck
EXIT_SHUT_DOWN = 10  # exit code after a shut-down command; the service manager does not restart the autopilot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="vehicle file")
    parser.add_argument("--state", metavar="DIR", type=Path, help="state directory: parameters, missions and logs")
    parser.add_argument(
        "--link",
        metavar="URL",
        action="append",
        default=[],
        help="a MAVLink link in addition to those of the vehicle file: udpout:HOST:PORT, udpin:HOST:PORT, "
        "tcpin:HOST:PORT, tcpout:HOST:PORT, serial:PATH:BAUD, or sbd:PATH for an Iridium modem; the prefix nmea: "
        "sends NMEA 0183 instead; may be repeated",
    )
    parser.add_argument(
        "--wait",
        action="store_true",
        help="start without missing ports, link addresses or state directory; use them when they appear",
    )
    parser.add_argument(
        "--watchdog",
        metavar="DEVICE",
        type=Path,
        help="hardware watchdog, such as /dev/watchdog; it restarts the computer if the autopilot hangs",
    )
    parser.add_argument("--lockstep", metavar="SOCKET", help=argparse.SUPPRESS)
    parser.add_argument("--status", action="store_true", help=argparse.SUPPRESS)
    # For the harness: exit when the parent process ends, which owns the simulated ports.
    parser.add_argument("--with-parent", metavar="PID", type=int, help=argparse.SUPPRESS)


def default_state_directory(name: str) -> Path:
    """Return the default state directory by the XDG rules; raise VehicleError for a user without a home directory."""
    root = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        if not root.is_absolute():
            if root.parts:
                text = f"XDG_STATE_HOME={root} is not absolute and is ignored; give an absolute path, or --state"
                print(f"rambler: {text}", file=sys.stderr)
            root = Path.home() / ".local" / "state"
    except RuntimeError:
        raise VehicleError("no home directory for the state; give a directory with --state") from None
    return root / "rambler" / "".join(c if c.isalnum() or c in "-_" else "-" for c in name.lower())


def run(arguments: argparse.Namespace) -> int:
    """Run until a signal or a shut-down command; a restart command replaces the process."""
    # Signals are handled before a port is opened, so that a signal always makes the rudder safe.
    with exact_modes(), Signals() as signals:
        if arguments.with_parent is not None and not realtime.end_with_parent(arguments.with_parent):
            return 0
        try:
            vehicle = load(arguments.vehicle)
            options = Options(
                arguments.state or default_state_directory(vehicle.name),
                tuple(arguments.link),
                wait=arguments.wait,
                lockstep=arguments.lockstep,
                status=arguments.status,
                runtime=runtime_directory(os.environ),
                # The GPS of the harness sends simulated time.
                may_set_clock=arguments.lockstep is None and arguments.with_parent is None,
            )
            _check_owner(options)
            assembly = assemble(vehicle, options)
            supervision = _supervise(assembly, arguments)
        except (VehicleError, PortError, StoreError, LinkError, ClockError, WatchdogError) as error:
            code = print_error("run", error)
            _delay_exit(str(error), signals)
            return code
        assembly.console.line(f"rambler {__version__}: {vehicle.name}, state in {options.state_directory}")
        code = _run_loop(assembly, supervision, signals, real_time=arguments.lockstep is None)
        restart = assembly.parts.autopilot.restart
        if code != 0 or restart is None or signals.is_stopping:
            return code
        if not restart.shutdown:
            signals.block()
            realtime.restart_program()
        return EXIT_SHUT_DOWN


def _check_owner(options: Options) -> None:
    """Raise StoreError if root uses the state of another user, who could not read files written by root.

    With --wait, as in a service, the autopilot starts in any case.
    """
    try:
        owner_uid = options.state_directory.stat().st_uid
    except OSError:
        return  # it will be created, or opening it reports the error
    if options.wait or os.geteuid() != 0 or owner_uid == 0:
        return
    from firmware_py.cli.state_owner import describe_user  # noqa: PLC0415 - it imports this module

    owner = describe_user(owner_uid)
    raise StoreError(f"state directory {options.state_directory} belongs to {owner}; run this as that user (sudo -u)")


def _supervise(assembly: Assembly, arguments: argparse.Namespace) -> Supervision:
    """Start the watchdogs; close the assembly and raise WatchdogError if one fails."""
    try:
        parts, endings, print_early = assembly.parts, assembly.endings, assembly.console.print_early
        return Supervision(parts, endings, print_early, os.environ, arguments.watchdog, wait=arguments.wait)
    except WatchdogError:
        assembly.close()
        raise


def _delay_exit(reason: str, signals: Signals) -> None:
    """Delay the exit under a service manager, which would otherwise restart the program in a fast loop."""
    manager = ServiceManager(os.environ)
    end_s = time.monotonic() + (RETRY_DELAY_S if manager.is_present else 0.0)
    manager.notify_status(reason)
    while time.monotonic() < end_s and not signals.is_stopping:
        time.sleep(0.1)


def _run_loop(assembly: Assembly, supervision: Supervision, signals: Signals, *, real_time: bool) -> int:
    """Run the control loop until it ends; return the exit code. The rudder is then safe and everything closed."""
    assembly.parts.signal_events = signals.take_events
    # After all threads have started, since it also sets their priorities.
    for refusal in realtime.prepare(ordinary=(FILES_THREAD,), real_time=real_time):
        assembly.console.line(refusal)
    try:
        run_loop(assembly.parts, lambda: signals.is_stopping)
    except StuckError as error:
        supervision.end_with_error(str(error))
        assembly.console.line(f"rambler run: {error}; rudder safe, restarting")
        _exit_stuck(assembly)
    except ClockError as error:
        assembly.console.line(f"rambler run: {error}")
        return 0 if signals.is_stopping else 1
    except Exception as error:  # noqa: BLE001 - the rudder is safe; the traceback must not wait for a blocked reader
        for line in traceback.format_exc().splitlines():
            assembly.console.line(line)
        supervision.end_with_error(f"{type(error).__name__}: {error}")
        return 1
    else:
        restart = assembly.parts.autopilot.restart
        supervision.end(restart=restart is not None and not restart.shutdown and not signals.is_stopping)
        return 0
    finally:
        assembly.close()


def _exit_stuck(assembly: Assembly) -> NoReturn:
    """End the process although a thread is stuck; close the rest within MAX_CLOSE_S."""
    thread = threading.Thread(target=assembly.close, daemon=True)
    thread.start()
    thread.join(MAX_CLOSE_S)
    os._exit(STUCK_EXIT_CODE)
