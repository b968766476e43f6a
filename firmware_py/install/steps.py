"""Installs and removes the files of the service."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from firmware_py.install.service_files import (
    PAGE_SERVICE_NAME,
    PAGE_UNIT,
    SERVICE_NAME,
    STATE,
    Service,
    ServiceFile,
    file_paths,
    is_hidden,
    service_files,
)

_FILE_MODE = 0o644
_SYSTEMD_RUNTIME = Path("/run/systemd/system")  # exists if systemd runs: sd_booted(3)
_INIT_ROOT = Path("/proc/1/root")  # the root directory of process 1, which is outside of any chroot
_SYSTEMD_PROGRAMS = (Path("/usr/lib/systemd/systemd"), Path("/lib/systemd/systemd"))
_UDEV_CONTROL = Path("/run/udev/control")  # exists if udev runs
_PROGRAM_TIMEOUT_S = 120.0
Report = Callable[[str], None]  # prints a line for the operator


class InstallError(RuntimeError):
    """The service cannot be installed or removed; the text names the reason and the remedy."""


def check_service(service: Service, root: Path) -> None:
    """Raise InstallError if the service cannot be installed or cannot start on this computer."""
    _check_systemd(root)
    for subject, path in (("vehicle file", service.vehicle), ("program", Path(service.program[0]))):
        if is_hidden(path):
            raise InstallError(f"{subject} {path}: not visible to a service; move it to /etc or /opt")
        if root == Path("/") and (unreadable := _find_unreadable_part(path)) is not None:
            raise InstallError(
                f"{subject} {path}: user {SERVICE_NAME} cannot read {unreadable}; chmod o+rX {unreadable}"
            )
    token = None if service.page is None else service.page.token
    if token is not None and not _path_in_root(root, token).is_file():
        raise InstallError(f"token file {token}: does not exist; create it: openssl rand -hex 16")
    if not service.state.is_absolute() or is_hidden(service.state):
        raise InstallError(f"state directory {service.state}: not visible to a service; omit --state")


def _check_systemd(root: Path) -> None:
    """Raise InstallError if systemd or its programs are missing."""
    if root == Path("/"):
        if not (_SYSTEMD_RUNTIME.is_dir() or _in_chroot()):
            raise InstallError("systemd does not run here, but the service needs it; for a system image use --root")
    elif not any(_path_in_root(root, path).exists() for path in _SYSTEMD_PROGRAMS):
        raise InstallError(f"--root {root}: no systemd found; the service needs it")
    for name in ("systemctl", "systemd-sysusers", *(["systemd-tmpfiles"] if root == Path("/") else [])):
        if shutil.which(name) is None:
            raise InstallError(f"{name} not found; the service needs systemd")


def _in_chroot() -> bool:
    """Return whether this process runs in a chroot, where no service is started."""
    try:
        return not _INIT_ROOT.samefile("/")
    except OSError:  # a chroot may have no /proc
        return True


def install(service: Service, root: Path, report: Report) -> None:
    """Write the files and enable the service; it starts at the next boot."""
    for file in service_files(service):
        report(_write(file, root))
    if root == Path("/"):
        run_program(["systemd-sysusers"])
        run_program(["systemd-tmpfiles", "--create", str(Path("/etc/tmpfiles.d/rambler.conf"))])
        run_program(["systemctl", "daemon-reload"])
        if shutil.which("udevadm") and _UDEV_CONTROL.exists():
            run_program(["udevadm", "control", "--reload"])
            run_program(["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=watchdog"])
    else:
        run_program(["systemd-sysusers", f"--root={root}"])
    services = [SERVICE_NAME] if service.page is None else [SERVICE_NAME, PAGE_SERVICE_NAME]
    run_program([*_systemctl(root), "--quiet", "enable", *services])


def remove(root: Path, report: Report) -> None:
    """Stop the service and remove its files, but not state, user and vehicle file."""
    existing = [path for path in file_paths() if _path_in_root(root, path).exists()]
    if not existing:
        report("the service is not installed")
        return
    stop_options = [] if root != Path("/") else ["--now"]
    services = [SERVICE_NAME, PAGE_SERVICE_NAME] if PAGE_UNIT in existing else [SERVICE_NAME]
    run_program([*_systemctl(root), "--quiet", "disable", *stop_options, *services])
    for path in existing:
        _path_in_root(root, path).unlink()
        report(f"removed {path}")
    if root == Path("/"):
        run_program(["systemctl", "daemon-reload"])
    report(f"kept: {STATE}, user {SERVICE_NAME}, the vehicle file")


def run_program(command: Sequence[str]) -> str:
    """Run a system program and return its output; raise InstallError with its last line if it fails."""
    try:
        process = subprocess.run(  # noqa: S603 - fixed arguments
            command, capture_output=True, text=True, timeout=_PROGRAM_TIMEOUT_S, check=False, errors="replace"
        )
    except FileNotFoundError:
        raise InstallError(f"{command[0]} not found; the service needs systemd") from None
    except (OSError, subprocess.SubprocessError) as error:
        raise InstallError(f"{command[0]}: {error}") from None
    if process.returncode != 0:
        lines = (process.stderr or process.stdout).strip().splitlines() or [f"exit code {process.returncode}"]
        raise InstallError(f"{' '.join(command)}: {lines[-1]}")
    return process.stdout


def _systemctl(root: Path) -> list[str]:
    return ["systemctl"] if root == Path("/") else ["systemctl", f"--root={root}"]


def _path_in_root(root: Path, path: Path) -> Path:
    return root / path.relative_to("/")


def _write(file: ServiceFile, root: Path) -> str:
    """Replace a file atomically; return a line for the operator."""
    path = _path_in_root(root, file.path)
    temporary = path.with_name(f".{path.name}.new")
    try:
        if path.is_file() and path.read_text(encoding="utf-8", errors="replace") == file.text:
            return f"unchanged {file.path}"
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        temporary.write_text(file.text, encoding="utf-8")
        temporary.chmod(_FILE_MODE)
        temporary.replace(path)
    except OSError as error:
        other_remedy = "make it writable" if root == Path("/") else "use another --root"
        remedy = "run it as root (sudo)" if isinstance(error, PermissionError) else other_remedy
        raise InstallError(f"{path}: {error.strerror}; {remedy}") from None
    return f"wrote {file.path}"


def _find_unreadable_part(path: Path) -> Path | None:
    """Return the first part of a path that other users cannot read or enter, None without one."""
    for part in (path, *path.parents):
        permission = stat.S_IXOTH if part.is_dir() else stat.S_IROTH
        try:
            mode = part.stat().st_mode
        except OSError:
            return part
        if not mode & permission:
            return part
    return None


def is_root() -> bool:
    """Return whether this process runs as root."""
    return os.geteuid() == 0
