"""Installs and removes the files of the service."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from firmware_py.install.service_files import (
    NAME,
    PAGE,
    PAGE_UNIT,
    STATE,
    Service,
    ServiceFile,
    file_paths,
    is_hidden,
    service_files,
)

_MODE = 0o644
_RUNNING = Path("/run/systemd/system")  # exists if systemd runs: sd_booted(3)
_FIRST_ROOT = Path("/proc/1/root")
_SYSTEMD = (Path("/usr/lib/systemd/systemd"), Path("/lib/systemd/systemd"))
_TIMEOUT_S = 120.0
Say = Callable[[str], None]


class InstallError(RuntimeError):
    """The service cannot be installed or removed; the text names the reason and the remedy."""


def check(service: Service, root: Path) -> None:
    """Raise InstallError if the service could not be installed or could not start on this computer."""
    _check_systemd(root)
    for what, path in (("vehicle file", service.vehicle), ("program", Path(service.program[0]))):
        if is_hidden(path):
            raise InstallError(f"{what} {path}: not visible to a service; move it to /etc or /opt")
        if root == Path("/") and (closed := _closed_to_others(path)) is not None:
            raise InstallError(f"{what} {path}: user {NAME} cannot read {closed}; chmod o+rX {closed}")
    if service.page is not None and service.page.token is not None and not _below(root, service.page.token).is_file():
        raise InstallError(f"token file {service.page.token}: does not exist; create it: openssl rand -hex 16")
    if not service.state.is_absolute() or is_hidden(service.state):
        raise InstallError(f"state directory {service.state}: not visible to a service; omit --state")


def _check_systemd(root: Path) -> None:
    """Raise InstallError without systemd, before anything is written."""
    if root == Path("/"):
        if not (_RUNNING.is_dir() or _in_chroot()):
            raise InstallError("systemd does not run here, but the service needs it; for a system image use --root")
    elif not any(_below(root, path).exists() for path in _SYSTEMD):
        raise InstallError(f"--root {root}: no systemd found, which the service needs")
    for name in ("systemctl", "systemd-sysusers", *(["systemd-tmpfiles"] if root == Path("/") else [])):
        if shutil.which(name) is None:
            raise InstallError(f"{name} not found; the service needs systemd")


def _in_chroot() -> bool:
    """Return whether this runs in a chroot, where no service is started."""
    try:
        return not _FIRST_ROOT.samefile("/")
    except OSError:
        return True


def install(service: Service, root: Path, say: Say) -> None:
    """Write the files and enable the service; it starts with the computer, not now."""
    for file in service_files(service):
        say(_write(file, root))
    if root == Path("/"):
        run(["systemd-sysusers"])
        run(["systemd-tmpfiles", "--create", str(Path("/etc/tmpfiles.d/rambler.conf"))])
        run(["systemctl", "daemon-reload"])
        if shutil.which("udevadm") and Path("/run/udev/control").exists():
            run(["udevadm", "control", "--reload"])
            run(["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=watchdog"])
    else:
        run(["systemd-sysusers", f"--root={root}"])
    run([*_systemctl(root), "--quiet", "enable", NAME, *([] if service.page is None else [PAGE])])


def remove(root: Path, say: Say) -> None:
    """Stop the service and remove its files; keep state, user and vehicle file."""
    present = [path for path in file_paths() if _below(root, path).exists()]
    if not present:
        say("the service is not installed")
        return
    stop = [] if root != Path("/") else ["--now"]
    run([*_systemctl(root), "--quiet", "disable", *stop, NAME, *([PAGE] if PAGE_UNIT in present else [])])
    for path in present:
        _below(root, path).unlink()
        say(f"removed {path}")
    if root == Path("/"):
        run(["systemctl", "daemon-reload"])
    say(f"kept: {STATE}, user {NAME}, the vehicle file")


def run(words: Sequence[str]) -> str:
    """Run a system program and return its output; raise InstallError with its last line if it fails."""
    try:
        process = subprocess.run(  # noqa: S603 - fixed arguments
            words, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False, errors="replace"
        )
    except FileNotFoundError:
        raise InstallError(f"{words[0]} not found; the service needs systemd") from None
    except (OSError, subprocess.SubprocessError) as error:
        raise InstallError(f"{words[0]}: {error}") from None
    if process.returncode != 0:
        lines = (process.stderr or process.stdout).strip().splitlines() or [f"exit code {process.returncode}"]
        raise InstallError(f"{' '.join(words)}: {lines[-1]}")
    return process.stdout


def _systemctl(root: Path) -> list[str]:
    return ["systemctl"] if root == Path("/") else ["systemctl", f"--root={root}"]


def _below(root: Path, path: Path) -> Path:
    return root / path.relative_to("/")


def _write(file: ServiceFile, root: Path) -> str:
    """Write a file by a rename; return a line for the operator."""
    path = _below(root, file.path)
    new = path.with_name(f".{path.name}.new")
    try:
        if path.is_file() and path.read_text(encoding="utf-8", errors="replace") == file.text:
            return f"unchanged {file.path}"
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        new.write_text(file.text, encoding="utf-8")
        new.chmod(_MODE)
        new.replace(path)
    except OSError as error:
        elsewhere = "make it writable" if root == Path("/") else "use another --root"
        remedy = "run it as root (sudo)" if isinstance(error, PermissionError) else elsewhere
        raise InstallError(f"{path}: {error.strerror}; {remedy}") from None
    return f"wrote {file.path}"


def _closed_to_others(path: Path) -> Path | None:
    """Return the part of a path that others cannot read or enter, None if there is none."""
    for part in (path, *path.parents):
        needed = stat.S_IXOTH if part.is_dir() else stat.S_IROTH
        try:
            mode = part.stat().st_mode
        except OSError:
            return part
        if not mode & needed:
            return part
    return None


def may_change_system() -> bool:
    """Return whether this process may change the system."""
    return os.geteuid() == 0
