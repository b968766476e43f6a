"""Checks of a new environment before it is installed, while the autopilot continues to run.

The checks do not use the devices, the links and the state of the boat: the new program uses a copy of the state
directory, ports that do not exist, and the simulator. Each check returns a line for the operator or raises UpdateError.
"""

from __future__ import annotations

import json
import os
import secrets
import select
import socket
import subprocess
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from firmware_py.files.reading import read_regular, read_text
from firmware_py.install.bundle import Bundle, UpdateError
from firmware_py.install.environment import Environment
from firmware_py.install.service_files import UNIT
from firmware_py.log.disk import log_files
from firmware_py.system.state_directory import LOG_DIRECTORY, PARAMETER_FILE

READY_TIMEOUT_S, ALIVE_S = 60.0, 3.0
COMMAND_TIMEOUT_S, REPLAY_TIMEOUT_S, SIMULATION_TIMEOUT_S = 120.0, 300.0, 600.0
# Goals: seconds:degrees, as in `rambler-hil run --goal`.
SIMULATION_GOALS, SIMULATION_S, MAX_HEADING_ERROR_DEG = "0:0,20:30", 320, 20.0
_DIFFERENCE_CODE, _REFUSED_CODE = 1, 2  # exit codes of `rambler replay` and `rambler-hil`
_MAX_STATE_BYTES, _MAX_VEHICLE_BYTES = 4 << 20, 1 << 20
_IMPORT_ALL = (
    "import importlib, pkgutil, firmware_py\n"
    "for module in pkgutil.walk_packages(firmware_py.__path__, 'firmware_py.'):\n"
    "    if not module.name.endswith('__main__'): importlib.import_module(module.name)\n"
)


class Candidate(msgspec.Struct, frozen=True):
    """The environment to check and its bundle, vehicle file, state directory and work directory."""

    environment: Environment
    bundle: Bundle
    vehicle: Path
    state: Path
    work: Path

    @property
    def copy(self) -> Path:
        """Return the copy of the state directory."""
        return self.work / "state"

    @property
    def vehicle_without_ports(self) -> Path:
        """Return the vehicle file with ports that do not exist and without links."""
        return self.work / "dry.toml"


def self_check(candidate: Candidate) -> Iterator[str]:
    """Run all checks and yield a line for each; raise UpdateError at the first failure."""
    _copy_state(candidate.state, candidate.copy)
    candidate.vehicle_without_ports.write_text(
        vehicle_text_without_ports(candidate.vehicle, candidate.work), encoding="utf-8"
    )
    for name, check in CHECKS.items():
        try:
            yield f"{name}: {check(candidate)}"
        except subprocess.TimeoutExpired as error:
            raise UpdateError(f"{name}: not finished within {error.timeout:.0f} s") from None


def vehicle_text_without_ports(vehicle: Path, work: Path) -> str:
    """Return the text of a vehicle file without links and with ports in `work` that do not exist."""
    try:
        sections: dict[str, Any] = tomllib.loads(read_text(vehicle, _MAX_VEHICLE_BYTES))
    except (OSError, ValueError) as error:
        raise UpdateError(f"vehicle file {vehicle}: {error}") from None
    sections.pop("link", None)
    ports: dict[str, str] = {}  # by original port, which two devices may share
    lines = []
    for name, section in sections.items():
        if not isinstance(section, dict):
            continue
        if "port" in section:
            section["port"] = ports.setdefault(str(section["port"]), str(work / f"port{len(ports)}"))
        if name == "parameters" and "file" in section:
            section["file"] = os.path.abspath(vehicle.parent / str(section["file"]))  # noqa: PTH100 - links stay
        lines.append(f"[{name}]")
        # TOML writes texts, numbers, flags and lists of texts as JSON does.
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False, default=str)}" for key, value in section.items()]
    return "\n".join(lines) + "\n"


def _copy_state(state: Path, copy: Path) -> None:
    """Copy the slots of a state directory."""
    copy.mkdir(mode=0o700)
    for path in sorted(state.glob("*.*.[01]")):
        try:
            (copy / path.name).write_bytes(read_regular(path, _MAX_STATE_BYTES, follow_symlinks=False))
            (copy / path.name).chmod(0o600)
        except OSError as error:
            raise UpdateError(f"{path} cannot be copied: {error.strerror}") from None


def _check_program(candidate: Candidate) -> str:
    python, program = str(candidate.environment.python), str(candidate.environment.program)
    _require_success(_run([python, "-I", "-c", _IMPORT_ALL]), "the new version cannot be imported")
    version = _require_success(_run([program, "--version"]), "the new version does not run").strip()
    if version != f"rambler {candidate.bundle.title}":
        raise UpdateError(
            f"the program reports {version!r}, its bundle {candidate.bundle.title!r}; build the bundle again"
        )
    return version


def _check_state(candidate: Candidate) -> str:
    """Check that the program reads the vehicle file, its drivers and the copy of the state; ignore ports."""
    arguments = ["check", str(candidate.vehicle_without_ports), "--state", str(candidate.copy), "--json"]
    process = _run([str(candidate.environment.program), *arguments])
    try:
        findings = json.loads(process.stdout)["findings"]
        relevant = [finding for finding in findings if finding["subject"] in ("drivers", "parameters", "state")]
        errors = [str(finding["text"]) for finding in relevant if finding["level"] == "fail"]
        notes = [str(finding["text"]) for finding in relevant if finding["level"] == "warn"]
    except (ValueError, KeyError, TypeError):
        raise UpdateError(f"the preflight check of the new version fails: {_last_line(process)}") from None
    if errors:
        raise UpdateError(f"the new version cannot be used: {errors[0]}")
    return "; ".join(notes) or "read completely"


def _check_start(candidate: Candidate) -> str:
    """Start the program without devices; check that its loop reports ready and runs for ALIVE_S after that."""
    address = f"\0rambler-update-{secrets.token_hex(8)}"
    arguments = [
        str(candidate.environment.program), "run", str(candidate.vehicle_without_ports), "--state", str(candidate.copy),
        "--wait", "--with-parent", str(os.getpid()),
    ]  # fmt: skip
    environment = {**os.environ, "NOTIFY_SOCKET": "@" + address[1:]}
    log = candidate.work / "start.log"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify_socket, log.open("wb") as output:
        notify_socket.bind(address)
        start_s = time.monotonic()
        process = subprocess.Popen(arguments, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output)  # noqa: S603 - fixed arguments
        try:
            ready_s = _await_ready(process, notify_socket, start_s)
            if ready_s is not None:
                time.sleep(ALIVE_S)
            is_alive = ready_s is not None and process.poll() is None
            process.terminate()
            code = process.wait(COMMAND_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            process.kill()
            process.wait()
    if not is_alive or code != 0:
        last_line = (log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["no output"])[-1]
        raise UpdateError(f"the new version does not start: {last_line[:300]}")
    return f"control loop ready after {ready_s:.1f} s"


def _await_ready(process: subprocess.Popen[bytes], notify_socket: socket.socket, start_s: float) -> float | None:
    while process.poll() is None and time.monotonic() < start_s + READY_TIMEOUT_S:
        if select.select([notify_socket], [], [], 0.1)[0] and b"READY=1" in notify_socket.recv(4096).splitlines():
            return time.monotonic() - start_s
    return None


def _check_simulation(candidate: Candidate) -> str:
    """Check that the program steers a simulated boat with the parameters of this boat, without its plans."""
    output_directory, parameter_directory = candidate.work / "box", candidate.work / "tuned"
    parameter_directory.mkdir()
    for path in candidate.copy.glob(f"{PARAMETER_FILE}.[01]"):
        (parameter_directory / path.name).write_bytes(path.read_bytes())
    arguments = [
        "run", "tank", "--speed", "max", "--vehicle", str(candidate.vehicle), "--state", str(parameter_directory),
        "--goal", SIMULATION_GOALS, "--seconds", str(SIMULATION_S), "--out", str(output_directory),
    ]  # fmt: skip
    process = _run([str(candidate.environment.path / "bin" / "rambler-hil"), *arguments], SIMULATION_TIMEOUT_S)
    if process.returncode == _REFUSED_CODE:
        return f"not checked: {_last_line(process)}"
    _require_success(process, "the new version fails in simulation")
    try:
        last_goal = json.loads((output_directory / "summary.json").read_text(encoding="utf-8"))["goals"][-1]
        error_deg = max(abs(float(last_goal["mean_error_deg"])), float(last_goal["rms_error_deg"]))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise UpdateError(f"no results of the simulation: {error}") from None
    if not error_deg < MAX_HEADING_ERROR_DEG:
        raise UpdateError(f"heading error of {error_deg:.0f} deg in simulation")
    return f"heading error {error_deg:.1f} deg (rms)"


def _check_replay(candidate: Candidate) -> str:
    """Replay the newest complete log; report a difference, which is expected from another version."""
    directory = candidate.state / LOG_DIRECTORY
    logs = log_files(directory) if directory.is_dir() else {}
    if not logs:
        return "no log"
    log = logs[sorted(logs)[-2:][0]]  # the last one may still be written
    try:
        process = _run([str(candidate.environment.program), "replay", str(log)], REPLAY_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"{log.name} not finished within {REPLAY_TIMEOUT_S:.0f} s, skipped"
    if process.returncode == _REFUSED_CODE:
        return f"{log.name}: {_last_line(process)}"
    if process.returncode == _DIFFERENCE_CODE and (lines := process.stdout.splitlines()):
        difference_lines = [line for line in lines if "differ" in line]
        if not difference_lines:
            return f"{log.name} is incomplete: {'; '.join(lines[:-1])}"
        return f"the new version steers differently: {log.name}, {difference_lines[0]}"
    _require_success(process, f"the new version cannot replay {log.name}")
    return f"{log.name} bit-identical"


CHECKS: Mapping[str, Callable[[Candidate], str]] = {
    "program": _check_program,
    "state": _check_state,
    "start": _check_start,
    "box": _check_simulation,
    "newest log": _check_replay,
}


def read_printed_unit(program: Path, arguments: Sequence[str]) -> str | None:
    """Return the unit that a program prints for these arguments; None if it fails."""
    header, separator = f"# {UNIT}\n", "\n\n# /"
    try:
        process = _run([str(program), "service", "print", *arguments])
    except (UpdateError, subprocess.TimeoutExpired):
        return None
    unit, separator_found, _ = process.stdout.removeprefix(header).partition(separator)
    return f"{unit}\n" if process.returncode == 0 and process.stdout.startswith(header) and separator_found else None


def _run(arguments: Sequence[str], timeout_s: float = COMMAND_TIMEOUT_S) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(  # noqa: S603 - fixed arguments
            arguments, capture_output=True, text=True, errors="replace", timeout=timeout_s, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except OSError as error:
        raise UpdateError(f"{arguments[0]} cannot be run: {error.strerror}") from None


def _require_success(process: subprocess.CompletedProcess[str], error: str) -> str:
    if process.returncode != 0:
        raise UpdateError(f"{error}: {_last_line(process)}")
    return process.stdout


def _last_line(process: subprocess.CompletedProcess[str]) -> str:
    lines = (process.stderr or process.stdout).strip().splitlines()
    return lines[-1][:300] if lines else f"exit code {process.returncode}"
