"""Virtual environments: each version of the autopilot has its own, in the same directory."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.files.reading import read_regular, read_text
from firmware_py.install.bundle import LIST, LOCK, Bundle, UpdateError, read_list
from firmware_py.install.service_files import SERVICE_NAME
from firmware_py.system.status_file import TRIAL_DIRECTORY

_CONFIG = "pyvenv.cfg"
_CREATED_NAME = re.compile(rf"{SERVICE_NAME}-\d.*-[0-9a-f]{{8}}")  # names from new_environment
_RESERVE_BYTES = 50_000_000  # for the autopilot, which may use the same disk
_COMPILED_FACTOR = 1.6  # by which compiled modules increase the size
DRIVER_GROUP: Final = "rambler.drivers"  # entry points of packages with drivers, as in devices.py
_TIMEOUT_S = 1200.0
_MAX_CONFIG_BYTES, _MAX_LIST_BYTES = 1 << 16, 1 << 20


class Environment(msgspec.Struct, frozen=True):
    """A virtual environment of the autopilot."""

    path: Path

    @property
    def program(self) -> Path:
        """Return the path of the autopilot."""
        return self.path / "bin" / SERVICE_NAME

    @property
    def python(self) -> Path:
        """Return the path of Python."""
        return self.path / "bin" / "python"

    def bundle(self) -> Bundle | None:
        """Return the list of its bundle; None if it is incomplete or was not made from a bundle."""
        try:
            return read_list(read_regular(self.path / LIST, _MAX_LIST_BYTES))
        except (OSError, UpdateError):
            return None


def read_environment(program: Path) -> Environment:
    """Return the environment of a program; raise UpdateError if a bundle cannot update it."""
    environment = Environment(program.parents[1])
    remedy = "install it as in docs/how-to/installation.md"
    try:
        text = read_text(environment.path / _CONFIG, _MAX_CONFIG_BYTES)
    except OSError:
        raise UpdateError(f"{program} is not in a virtual environment; {remedy}") from None
    settings = {name.strip(): value.strip() for name, _, value in (line.partition("=") for line in text.splitlines())}
    if settings.get("include-system-site-packages") == "true":
        raise UpdateError(
            f"{environment.path} uses packages of the system, which a bundle cannot replace; make the new environment "
            "by hand (docs/how-to/installation.md, A board without wheels) and point the link to it"
        )
    return environment


def check_driver_packages(environment: Environment, bundle: Bundle) -> list[str]:
    """Return name and version of the driver packages that are installed in an environment.

    Raises UpdateError if the bundle lacks one of them, because the boat would lose the device.
    """
    from importlib.metadata import distributions  # noqa: PLC0415 - takes long to import, and only an update needs it

    folders = [str(path) for path in environment.path.glob("lib/python*/site-packages")]
    names = []
    for package in distributions(path=folders):
        if not package.entry_points.select(group=DRIVER_GROUP):
            continue
        names.append(f"{package.name} {package.version}")
        prefix = f"{re.sub('[-_.]+', '_', package.name).lower()}-"
        if not any(name.lower().startswith(prefix) and name.endswith(".whl") for name in bundle.files):
            raise UpdateError(
                f"the bundle lacks the installed driver package {names[-1]}; make bundle DRIVERS=WHEEL, "
                f"or remove the package from {environment.path}"
            )
    return names


def new_environment(environment: Environment, bundle: Bundle) -> Environment:
    """Return the environment for a bundle, in the same directory as the given one."""
    return Environment(environment.path.with_name(f"{SERVICE_NAME}-{bundle.version}-{bundle.digest[:8]}"))


def create_work_directory(environment: Environment) -> Path:
    """Create an empty work directory on the same disk; remove the one of an interrupted update."""
    folder = environment.path.with_name(TRIAL_DIRECTORY)
    _remove(folder)
    folder.mkdir(mode=0o700)
    return folder


def remove_other_environments(kept: Sequence[Environment]) -> list[str]:
    """Remove the environments of earlier updates except `kept`; return the names of those removed."""
    others = [
        path
        for path in sorted(kept[0].path.parent.iterdir())
        if _CREATED_NAME.fullmatch(path.name)
        and (path / _CONFIG).is_file()
        and Environment(path) not in kept
        and not path.is_symlink()
    ]
    for path in others:
        _remove(path)
    return [path.name for path in others]


def check_free_space(environment: Environment, wheels: Path) -> None:
    """Raise UpdateError if the disk has too little free space for an environment of these wheels."""
    size_by_package: dict[str, int] = {}  # by package, of which one wheel is installed
    for wheel in wheels.glob("*.whl"):
        try:
            with zipfile.ZipFile(wheel) as archive:
                size = sum(info.file_size for info in archive.infolist())
        except (OSError, zipfile.BadZipFile) as error:
            raise UpdateError(f"{wheel.name} is not a wheel: {error}; build the bundle again") from None
        package = wheel.name.partition("-")[0]
        size_by_package[package] = max(size, size_by_package.get(package, 0))
    needed_bytes = int(sum(size_by_package.values()) * _COMPILED_FACTOR) + _RESERVE_BYTES
    free_bytes = shutil.disk_usage(environment.path.parent).free
    if free_bytes < needed_bytes:
        raise UpdateError(
            f"{environment.path.parent} has {free_bytes / 1e6:.0f} MB free, "
            f"an update needs {needed_bytes / 1e6:.0f} MB; free space"
        )


def create(environment: Environment, wheels: Path, bundle: Bundle, lock: int) -> None:
    """Create an environment from the wheels of a bundle with venv and pip; raise UpdateError on failure.

    The list of the bundle is written last: an environment without it is incomplete. The child processes inherit the
    descriptor `lock`, so that another update is refused until they end.
    """
    if importlib.util.find_spec("venv") is None:
        raise UpdateError("this Python has no venv module; apt-get install python3-venv")
    _remove(environment.path)
    # pip runs from its wheel without installation.
    pip = [str(environment.python), str(wheels / bundle.wheel_of("pip") / "pip")]
    # fmt: off
    options = [
        "--isolated", "--disable-pip-version-check", "--no-input", "--no-cache-dir", "--quiet", "--no-index",
        "--find-links", str(wheels), "--only-binary", ":all:", "--require-hashes", "--requirement", str(wheels / LOCK),
    ]
    # fmt: on
    _run([sys.executable, "-I", "-m", "venv", "--without-pip", str(environment.path)], lock)
    _run([*pip, "install", *options], lock)
    os.sync()
    temporary = environment.path / f"{LIST}.part"
    shutil.copyfile(wheels / LIST, temporary)
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    temporary.replace(environment.path / LIST)


def _run(command: Sequence[str], lock: int) -> None:
    try:
        process = subprocess.run(  # noqa: S603 - fixed arguments
            command, capture_output=True, timeout=_TIMEOUT_S, check=False, stdin=subprocess.DEVNULL, pass_fds=(lock,)
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise UpdateError(f"{command[0]}: {error}") from None
    if process.returncode != 0:
        lines = (process.stderr or process.stdout).decode("utf-8", "replace").strip().splitlines()
        errors = [line for line in lines if line.startswith("ERROR:")] or lines or [f"exit code {process.returncode}"]
        raise UpdateError(f"the new environment cannot be made: {errors[0][:300]}")


def _remove(path: Path) -> None:
    """Remove a directory, its list first, so that an incompletely removed one does not count as complete."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        (path / LIST).unlink()
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
