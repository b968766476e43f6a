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
from firmware_py.cli.refusal import refused
from firmware_py.core.liveness import StuckError
from firmware_py.files.making import exact_modes
from firmware_py.link.wire.urls import LinkError
from firmware_py.link.wire.worker import THREAD as FILES_THREAD
from firmware_py.loop import run as run_loop
from firmware_py.system import realtime
from firmware_py.system.clock import ClockError
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.endings import EXIT_STUCK
from firmware_py.system.hardware_watchdog import WatchdogError
from firmware_py.system.serial_port import PortError
from firmware_py.system.service_manager import ServiceManager, runtime_directory
from firmware_py.system.signals import Signals
from firmware_py.vehicle import VehicleError, load

HOLD_OFF_S = 5.0  # under a service manager, a start that has failed is tried again after this long
CLOSE_S = 2.0  # for all that may be closed in good order beside what is stuck
SHUT_DOWN = 10  # the exit code of an autopilot that was told to shut down; a supervisor should leave it so


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="the vehicle file")
    parser.add_argument("--state", metavar="DIR", type=Path, help="directory of parameters, missions and logs")
    parser.add_argument(
        "--link",
        metavar="URL",
        action="append",
        default=[],
        help="a MAVLink link besides those of the vehicle file: udpout:HOST:PORT, udpin:HOST:PORT, "
        "tcpin:HOST:PORT, tcpout:HOST:PORT, serial:PATH:BAUD, or sbd:PATH of an Iridium modem; nmea: "
        "before one says NMEA 0183 there; may be given several times",
    )
    parser.add_argument(
        "--wait",
        action="store_true",
        help="start even while a port, a link's address or the state directory is not to be had; take it up when it is",
    )
    parser.add_argument(
        "--watchdog",
        metavar="DEVICE",
        type=Path,
        help="the computer's own watchdog, such as /dev/watchdog: it starts the computer anew when the autopilot hangs",
    )
    parser.add_argument("--lockstep", metavar="SOCKET", help=argparse.SUPPRESS)
    parser.add_argument("--status", action="store_true", help=argparse.SUPPRESS)
    # For the harness: an autopilot without its box would take up the ports of the next one.
    parser.add_argument("--with-parent", metavar="PID", type=int, help=argparse.SUPPRESS)


def default_state_directory(name: str) -> Path:
    """Return the place of the state where none is given, by the XDG rules; VehicleError for a user without a home."""
    root = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        if not root.is_absolute():
            if root.parts:
                ignored = f"XDG_STATE_HOME={root} is not absolute and is ignored"
                print(f"rambler: {ignored}; give an absolute path, or --state", file=sys.stderr)
            root = Path.home() / ".local" / "state"
    except RuntimeError:
        raise VehicleError("you have no home to keep the state in; name a directory by --state") from None
    return root / "rambler" / "".join(c if c.isalnum() or c in "-_" else "-" for c in name.lower())


def run(arguments: argparse.Namespace) -> int:
    """Run until told to stop or to shut down; told to restart, become a new process in place."""
    # Before any port is opened: a rudder that an earlier process has left over shall not stay there.
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
                # The harness's GPS shows the time of its own world.
                may_set_clock=arguments.lockstep is None and arguments.with_parent is None,
            )
            _check_owner(options)
            assembly = assemble(vehicle, options)
            supervision = _supervise(assembly, arguments)
        except (VehicleError, PortError, StoreError, LinkError, ClockError, WatchdogError) as error:
            code = refused("run", error)
            _hold_off(str(error), signals)
            return code
        assembly.console.line(f"rambler {__version__}: {vehicle.name}, state in {options.state_directory}")
        code = _steer(assembly, supervision, signals, real_time=arguments.lockstep is None)
        restart = assembly.parts.autopilot.restart
        if code != 0 or restart is None or signals.stopping:
            return code
        if not restart.shutdown:
            signals.hold()
            realtime.restart_program()
        return SHUT_DOWN


def _check_owner(options: Options) -> None:
    """Raise StoreError for root on the state of another user, who could not use the files that root would leave.

    With --wait, as in a service, she starts whatever she finds.
    """
    try:
        owner_uid = options.state_directory.stat().st_uid
    except OSError:
        return  # it is to be made, or what is wrong is told where it is opened
    if options.wait or os.geteuid() != 0 or owner_uid == 0:
        return
    from firmware_py.cli.state_owner import user_text  # noqa: PLC0415 - it stands on this module

    owner = user_text(owner_uid)
    raise StoreError(f"state directory {options.state_directory} belongs to {owner}; run this as that user (sudo -u)")


def _supervise(assembly: Assembly, arguments: argparse.Namespace) -> Supervision:
    """Put the run under the watch of whom there is; what has been opened is closed again when that cannot be."""
    try:
        return Supervision(
            assembly.parts,
            assembly.endings,
            assembly.console.ahead,
            os.environ,
            arguments.watchdog,
            wait=arguments.wait,
        )
    except WatchdogError:
        assembly.close()
        raise


def _hold_off(why: str, signals: Signals) -> None:
    """Wait a little, where a service manager would start it again at once and for ever."""
    manager = ServiceManager(os.environ)
    end_s = time.monotonic() + (HOLD_OFF_S if manager.present else 0.0)
    manager.notify_status(why)
    while time.monotonic() < end_s and not signals.stopping:
        time.sleep(0.1)


def _steer(assembly: Assembly, supervision: Supervision, signals: Signals, *, real_time: bool) -> int:
    assembly.parts.take_signals = signals.take_events
    # After all threads are there: theirs is lower than the loop's, and that of the files is for stations to load.
    for refusal in realtime.prepare(ordinary=(FILES_THREAD,), real_time=real_time):
        assembly.console.line(refusal)
    try:
        run_loop(assembly.parts, lambda: signals.stopping)
    except StuckError as error:
        supervision.end_badly(str(error))
        assembly.console.line(f"rambler run: {error}; the rudder is safe, started anew")
        _leave(assembly)
    except ClockError as error:
        assembly.console.line(f"rambler run: {error}")
        return 0 if signals.stopping else 1
    except Exception as error:  # noqa: BLE001 - the rudder is safe; Python's own traceback would wait for a reader that is stuck
        for line in traceback.format_exc().splitlines():
            assembly.console.line(line)
        supervision.end_badly(f"{type(error).__name__}: {error}")
        return 1
    else:
        restart = assembly.parts.autopilot.restart
        supervision.end(anew=restart is not None and not restart.shutdown and not signals.stopping)
        return 0
    finally:
        assembly.close()


def _leave(assembly: Assembly) -> NoReturn:
    """End the process, whatever a part of it that is stuck may hold; the rest is closed if that is quick."""
    closing = threading.Thread(target=assembly.close, daemon=True)
    closing.start()
    closing.join(CLOSE_S)
    os._exit(EXIT_STUCK)
