"""`rambler service`: install the autopilot as a systemd service, show its status, or remove it."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from firmware_py.install.service_files import PAGE_SERVICE_NAME, SERVICE_NAME, STATE, Page, Service, service_files
from firmware_py.install.steps import InstallError, check_service, install, is_root, remove, run_program
from firmware_py.vehicle import VehicleError, load
from firmware_py.view.guard import DEFAULT_LISTEN, ViewError, parse_listen_address

# Property of systemctl -> key of --json.
_PROPERTIES: Mapping[str, str] = {
    "LoadState": "load", "UnitFileState": "enabled", "ActiveState": "active", "SubState": "sub", "Result": "result",
    "NRestarts": "restarts", "MainPID": "pid", "StatusText": "status", "ActiveEnterTimestamp": "since",
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    commands = parser.add_subparsers(dest="service_command", metavar="WHAT", required=True)
    print_parser = commands.add_parser("print", help="print the files that install would write, with their paths")
    install_parser = commands.add_parser(
        "install", help="write the files, create the user and enable the service; does not start it"
    )
    status_parser = commands.add_parser(
        "status", help="show whether the service is installed, enabled and running; exit code 0 if it runs"
    )
    remove_parser = commands.add_parser(
        "remove", help="stop the service and remove its files; keeps the state directory"
    )
    for command in (print_parser, install_parser):
        command.add_argument(
            "vehicle", metavar="VEHICLE.toml", type=Path, help="vehicle file, such as /etc/rambler/boat.toml"
        )
        command.add_argument(
            "--state", metavar="DIR", type=Path, default=STATE, help=f"state directory (default: {STATE})"
        )
        command.add_argument(
            "--watchdog", metavar="DEVICE", type=Path, help="hardware watchdog, such as /dev/watchdog (see rambler run)"
        )
        command.add_argument(
            "--view",
            metavar="HOST:PORT",
            nargs="?",
            const=DEFAULT_LISTEN,
            help=f"also install a service for rambler view, at this address (default: {DEFAULT_LISTEN})",
        )
        command.add_argument(
            "--view-token", metavar="FILE", type=Path, help="token file for --view (see rambler view --token)"
        )
        command.add_argument("--program", metavar="FILE", type=Path, help="program to run (default: this one)")
    for command in (install_parser, remove_parser):
        command.add_argument(
            "--root", metavar="DIR", type=Path, default=Path("/"), help="root directory of a system image (default: /)"
        )
    status_parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Run a subcommand; return 2 with one line on standard error if it fails, 1 for the status of a stopped service."""
    command: Callable[[argparse.Namespace], int] = {
        "print": _print_files, "install": _install, "status": _print_status, "remove": _remove,
    }[arguments.service_command]  # fmt: skip
    try:
        return command(arguments)
    except (InstallError, VehicleError) as error:
        print(f"rambler service {arguments.service_command}: {error}", file=sys.stderr)
        return 2


def _print_files(arguments: argparse.Namespace) -> int:
    for file in service_files(_make_service(arguments)):
        print(f"# {file.path}\n{file.text}")
    return 0


def _install(arguments: argparse.Namespace) -> int:
    _check_root(arguments.root)
    load(arguments.root / str(arguments.vehicle).lstrip("/") if arguments.root != Path("/") else arguments.vehicle)
    service = _make_service(arguments)
    check_service(service, arguments.root)
    install(service, arguments.root, print)
    names = SERVICE_NAME if service.page is None else f"{SERVICE_NAME} {PAGE_SERVICE_NAME}"
    print(f"enabled: starts with the computer; to start it now: systemctl start {names}")
    return 0


def _remove(arguments: argparse.Namespace) -> int:
    _check_root(arguments.root)
    remove(arguments.root, print)
    return 0


def _print_status(arguments: argparse.Namespace) -> int:
    text = run_program(["systemctl", "show", SERVICE_NAME, "--property", ",".join(_PROPERTIES)])
    values = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    status = {key: values.get(name, "") for name, key in _PROPERTIES.items()}
    if arguments.json:
        print(json.dumps(status))
    elif status["load"] != "loaded":
        print("not installed")
    else:
        running = f"{status['active']} ({status['sub']}) since {status['since'] or 'never'}"
        print(f"{status['enabled']}, {running}, {status['restarts']} restarts, last result {status['result']}")
        if status["status"]:
            print(status["status"])
    return 0 if status["active"] == "active" else 1


def _make_service(arguments: argparse.Namespace) -> Service:
    program = _find_program() if arguments.program is None else (str(_absolute_path(arguments.program)),)
    vehicle, state = _absolute_path(arguments.vehicle), _absolute_path(arguments.state)
    return Service(program, vehicle, state, arguments.watchdog, _make_page(arguments))


def _make_page(arguments: argparse.Namespace) -> Page | None:
    token = None if arguments.view_token is None else _absolute_path(arguments.view_token)
    if arguments.view is None:
        if token is not None:
            raise InstallError("--view-token needs --view")
        return None
    try:
        parse_listen_address(arguments.view, with_token=token is not None)
    except ViewError as error:
        raise InstallError(f"--view {error}") from None
    return Page(arguments.view, token)


def _find_program() -> tuple[str, ...]:
    """Return the command that runs this program. Links are not resolved, since an update changes them."""
    script = shutil.which(sys.argv[0])
    if script is not None and Path(script).name == SERVICE_NAME:
        return (os.path.abspath(script),)  # noqa: PTH100 - resolve() would follow links
    return (sys.executable, "-m", "firmware_py")


def _absolute_path(path: Path) -> Path:
    return Path(os.path.abspath(path))  # noqa: PTH100 - resolve() would follow links


def _check_root(root: Path) -> None:
    """Raise InstallError if this user may not change the system or the directory is missing."""
    if root == Path("/") and not is_root():
        raise InstallError("this changes the system; run it as root (sudo)")
    if not root.is_dir():
        raise InstallError(f"--root {root}: no such directory; give the root directory of a system")
