"""What a new environment must do before it is put in force, beside the autopilot that sails meanwhile.

Nothing here touches her devices, her links or her state: the new program works on a copy of the state directory, on
ports that are not there, and in the box. Each check is a row; it returns what is told of it, or raises UpdateError.
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

READY_S, LIFE_S, COMMAND_S, REPLAY_S, BOX_S = 60.0, 3.0, 120.0, 300.0, 600.0
BOX_GOALS, BOX_SECONDS, BOX_ERROR_DEG = "0:0,20:30", 320, 20.0
_DIFFERS, _CANNOT = 1, 2  # exit codes of `rambler replay` and `rambler-hil`
_MOST_STATE_BYTES, _MOST_VEHICLE_BYTES = 4 << 20, 1 << 20
_IMPORT_ALL = (
    "import importlib, pkgutil, firmware_py\n"
    "for module in pkgutil.walk_packages(firmware_py.__path__, 'firmware_py.'):\n"
    "    if not module.name.endswith('__main__'): importlib.import_module(module.name)\n"
)


class Candidate(msgspec.Struct, frozen=True):
    """What is checked: an environment of a bundle, for a vehicle file and a state directory; and where to work."""

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
    def dry_vehicle(self) -> Path:
        """Return the vehicle file with ports that are not there and without links."""
        return self.work / "dry.toml"


def self_check(candidate: Candidate) -> Iterator[str]:
    """Do all checks and yield a line for each; UpdateError for the first that fails."""
    _copy_state(candidate.state, candidate.copy)
    candidate.dry_vehicle.write_text(dry_text(candidate.vehicle, candidate.work), encoding="utf-8")
    for name, check in CHECKS.items():
        try:
            yield f"{name}: {check(candidate)}"
        except subprocess.TimeoutExpired as error:
            raise UpdateError(f"{name}: not done within {error.timeout:.0f} s") from None


def dry_text(vehicle: Path, work: Path) -> str:
    """Return a vehicle file's text with each port led into `work`, where there are none, and without links."""
    try:
        sections: dict[str, Any] = tomllib.loads(read_text(vehicle, _MOST_VEHICLE_BYTES))
    except (OSError, ValueError) as error:
        raise UpdateError(f"vehicle file {vehicle}: {error}") from None
    sections.pop("link", None)
    ports: dict[str, str] = {}  # two devices may hang on one
    lines = []
    for name, section in sections.items():
        if not isinstance(section, dict):
            continue
        if "port" in section:
            section["port"] = ports.setdefault(str(section["port"]), str(work / f"port{len(ports)}"))
        if name == "parameters" and "file" in section:
            section["file"] = os.path.abspath(vehicle.parent / str(section["file"]))  # noqa: PTH100 - links stay
        lines.append(f"[{name}]")
        # A JSON text, number, flag or list of texts is also the TOML one.
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False, default=str)}" for key, value in section.items()]
    return "\n".join(lines) + "\n"


def _copy_state(state: Path, copy: Path) -> None:
    """Copy what is kept of earlier runs, the logs left out."""
    copy.mkdir(mode=0o700)
    for path in sorted(state.glob("*.*.[01]")):
        try:
            (copy / path.name).write_bytes(read_regular(path, _MOST_STATE_BYTES, follow=False))
            (copy / path.name).chmod(0o600)
        except OSError as error:
            raise UpdateError(f"{path} cannot be copied: {error.strerror}") from None


def _imports(candidate: Candidate) -> str:
    python, program = str(candidate.environment.python), str(candidate.environment.program)
    _good(_run([python, "-I", "-c", _IMPORT_ALL]), "it cannot be imported")
    said = _good(_run([program, "--version"]), "it does not run").strip()
    if said != f"rambler {candidate.bundle.title}":
        raise UpdateError(f"it says that it is {said!r}, and its list {candidate.bundle.title!r}; make it anew")
    return said


def _reads_state(candidate: Candidate) -> str:
    """Have it read the vehicle file and the copy of the state; what hangs on ports is not looked at here."""
    words = ["check", str(candidate.dry_vehicle), "--state", str(candidate.copy), "--json"]
    done = _run([str(candidate.environment.program), *words])
    try:
        findings = json.loads(done.stdout)["findings"]
        told = [finding for finding in findings if finding["subject"] in ("parameters", "state")]
        wrong = [str(finding["text"]) for finding in told if finding["level"] == "fail"]
        notes = [str(finding["text"]) for finding in told if finding["level"] == "warn"]
    except (ValueError, KeyError, TypeError):
        raise UpdateError(f"its preflight fails: {_last_line(done)}") from None
    if wrong:
        raise UpdateError(f"it cannot use the state: {wrong[0]}")
    return "; ".join(notes) or "all of it is read"


def _starts(candidate: Candidate) -> str:
    """Start it without devices and wait until its loop is alive, as the service does, and for some time after."""
    address = f"\0rambler-update-{secrets.token_hex(8)}"
    words = [
        str(candidate.environment.program), "run", str(candidate.dry_vehicle), "--state", str(candidate.copy), "--wait",
        "--with-parent", str(os.getpid()),
    ]  # fmt: skip
    environment = {**os.environ, "NOTIFY_SOCKET": "@" + address[1:]}
    log = candidate.work / "start.log"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard, log.open("wb") as output:
        heard.bind(address)
        begun_s = time.monotonic()
        process = subprocess.Popen(words, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output)  # noqa: S603 - words of our own
        try:
            ready_s = _await_ready(process, heard, begun_s)
            if ready_s is not None:
                time.sleep(LIFE_S)
            alive = ready_s is not None and process.poll() is None
            process.terminate()
            code = process.wait(COMMAND_S)
        except subprocess.TimeoutExpired:
            alive, code = False, None
        finally:
            process.kill()
            process.wait()
    if not alive or code != 0:
        last = (log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["it says nothing"])[-1]
        raise UpdateError(f"it does not start: {last[:300]}")
    return f"its loop is alive after {ready_s:.1f} s"


def _await_ready(process: subprocess.Popen[bytes], heard: socket.socket, begun_s: float) -> float | None:
    while process.poll() is None and time.monotonic() < begun_s + READY_S:
        if select.select([heard], [], [], 0.1)[0] and b"READY=1" in heard.recv(4096).splitlines():
            return time.monotonic() - begun_s
    return None


def _sails_in_box(candidate: Candidate) -> str:
    """Have it steer a stand-in of the boat, with her parameters and without her plans: the sea is another one."""
    out, tuned = candidate.work / "box", candidate.work / "tuned"
    tuned.mkdir()
    for path in candidate.copy.glob(f"{PARAMETER_FILE}.[01]"):
        (tuned / path.name).write_bytes(path.read_bytes())
    words = [
        "run", "tank", "--speed", "max", "--vehicle", str(candidate.vehicle), "--state", str(tuned),
        "--goal", BOX_GOALS, "--seconds", str(BOX_SECONDS), "--out", str(out),
    ]  # fmt: skip
    done = _run([str(candidate.environment.path / "bin" / "rambler-hil"), *words], BOX_S)
    if done.returncode == _CANNOT:
        return f"not tried: {_last_line(done)}"
    _good(done, "it does not sail in the box")
    try:
        last = json.loads((out / "summary.json").read_text(encoding="utf-8"))["goals"][-1]
        error_deg = max(abs(float(last["mean_error_deg"])), float(last["rms_error_deg"]))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise UpdateError(f"it leaves no figures of its run in the box: {error}") from None
    if not error_deg < BOX_ERROR_DEG:
        raise UpdateError(f"in the box it is {error_deg:.0f} deg off its heading")
    return f"it holds its heading to {error_deg:.1f} deg (rms)"


def _replays(candidate: Candidate) -> str:
    """Have it compute the newest log anew; one that another version wrote may come out otherwise, which is told."""
    directory = candidate.state / LOG_DIRECTORY
    logs = log_files(directory) if directory.is_dir() else {}
    if not logs:
        return "there is no log"
    log = logs[sorted(logs)[-2:][0]]  # the newest one of all may still be written
    try:
        done = _run([str(candidate.environment.program), "replay", str(log)], REPLAY_S)
    except subprocess.TimeoutExpired:
        return f"{log.name} not done within {REPLAY_S:.0f} s, left"
    if done.returncode == _CANNOT:
        return f"{log.name}: {_last_line(done)}"
    if done.returncode == _DIFFERS and (lines := done.stdout.splitlines()):
        differ = [line for line in lines if "differ" in line]
        if not differ:
            return f"{log.name} is not whole: {'; '.join(lines[:-1])}"
        return f"it would have steered otherwise: {log.name}, {differ[0]}"
    _good(done, f"it cannot replay {log.name}")
    return f"{log.name} comes out the same, bit for bit"


CHECKS: Mapping[str, Callable[[Candidate], str]] = {
    "program": _imports,
    "state": _reads_state,
    "start": _starts,
    "box": _sails_in_box,
    "newest log": _replays,
}


def printed_unit(program: Path, words: Sequence[str]) -> str | None:
    """Return the unit that a program prints for a service, None when it prints none."""
    head, between = f"# {UNIT}\n", "\n\n# /"
    try:
        done = _run([str(program), "service", "print", *words])
    except (UpdateError, subprocess.TimeoutExpired):
        return None
    unit, found, _ = done.stdout.removeprefix(head).partition(between)
    return f"{unit}\n" if done.returncode == 0 and done.stdout.startswith(head) and found else None


def _run(words: Sequence[str], patience_s: float = COMMAND_S) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(  # noqa: S603 - words of our own
            words, capture_output=True, text=True, errors="replace", timeout=patience_s, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except OSError as error:
        raise UpdateError(f"{words[0]} cannot be run: {error.strerror}") from None


def _good(done: subprocess.CompletedProcess[str], wrong: str) -> str:
    if done.returncode != 0:
        raise UpdateError(f"{wrong}: {_last_line(done)}")
    return done.stdout


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = (done.stderr or done.stdout).strip().splitlines()
    return lines[-1][:300] if lines else f"exit code {done.returncode}"
