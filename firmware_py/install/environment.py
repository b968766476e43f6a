"""Virtual environments: each version of the autopilot has its own directory next to the installed one."""

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

import msgspec

from firmware_py.files.reading import read_regular, read_text
from firmware_py.install.bundle import LIST, LOCK, Bundle, UpdateError, read_list
from firmware_py.install.service_files import NAME
from firmware_py.system.status_file import TRIAL_DIRECTORY

_CONFIG = "pyvenv.cfg"
_MADE = re.compile(rf"{NAME}-\d.*-[0-9a-f]{{8}}")  # names given by environment_for()
_RESERVE_BYTES = 50_000_000  # left for the autopilot, which may share the disk
_COMPILED_FACTOR = 1.6  # size with compiled modules
_TIMEOUT_S = 1200.0
_MAX_CONFIG_BYTES, _MAX_LIST_BYTES = 1 << 16, 1 << 20


class Environment(msgspec.Struct, frozen=True):
    """One virtual environment."""

    path: Path

    @property
    def program(self) -> Path:
        """Return the path of the autopilot."""
        return self.path / "bin" / NAME

    @property
    def python(self) -> Path:
        """Return the path of Python."""
        return self.path / "bin" / "python"

    def bundle(self) -> Bundle | None:
        """Return the list of the bundle it was made from; None if it is incomplete or was made otherwise."""
        try:
            return read_list(read_regular(self.path / LIST, _MAX_LIST_BYTES))
        except (OSError, UpdateError):
            return None


def environment_of(program: Path) -> Environment:
    """Return the environment of a program; raise UpdateError if it cannot be updated."""
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


def environment_for(environment: Environment, bundle: Bundle) -> Environment:
    """Return the environment for a bundle, in the same directory as the given one."""
    return Environment(environment.path.with_name(f"{NAME}-{bundle.version}-{bundle.digest[:8]}"))


def work_directory(environment: Environment) -> Path:
    """Return an empty work directory on the same disk; remove that of an interrupted update."""
    folder = environment.path.with_name(TRIAL_DIRECTORY)
    _remove(folder)
    folder.mkdir(mode=0o700)
    return folder


def remove_others(kept: Sequence[Environment]) -> list[str]:
    """Remove the environments of earlier updates except these; return the names."""
    others = [
        path
        for path in sorted(kept[0].path.parent.iterdir())
        if _MADE.fullmatch(path.name)
        and (path / _CONFIG).is_file()
        and Environment(path) not in kept
        and not path.is_symlink()
    ]
    for path in others:
        _remove(path)
    return [path.name for path in others]


def check_room(environment: Environment, wheels: Path) -> None:
    """Raise UpdateError if the disk has too little space for an environment of these wheels."""
    largest: dict[str, int] = {}  # one wheel of each package is installed
    for wheel in wheels.glob("*.whl"):
        try:
            with zipfile.ZipFile(wheel) as archive:
                size = sum(info.file_size for info in archive.infolist())
        except (OSError, zipfile.BadZipFile) as error:
            raise UpdateError(f"{wheel.name} is not a wheel: {error}; build the bundle again") from None
        package = wheel.name.partition("-")[0]
        largest[package] = max(size, largest.get(package, 0))
    needed = int(sum(largest.values()) * _COMPILED_FACTOR) + _RESERVE_BYTES
    free = shutil.disk_usage(environment.path.parent).free
    if free < needed:
        raise UpdateError(
            f"{environment.path.parent} has {free / 1e6:.0f} MB free, an update needs {needed / 1e6:.0f} MB; free space"
        )


def make(environment: Environment, wheels: Path, bundle: Bundle, lock: int) -> None:
    """Make an environment from the wheels of a bundle with venv and pip; raise UpdateError on failure.

    The list of the bundle is written last: an environment without it is incomplete. The child processes inherit the
    lock, so that the next update waits for them.
    """
    if importlib.util.find_spec("venv") is None:
        raise UpdateError("this Python has no venv module; apt-get install python3-venv")
    _remove(environment.path)
    # pip is run from its wheel and need not be installed.
    pip = [str(environment.python), str(wheels / bundle.of("pip") / "pip")]
    # fmt: off
    options = [
        "--isolated", "--disable-pip-version-check", "--no-input", "--no-cache-dir", "--quiet", "--no-index",
        "--find-links", str(wheels), "--only-binary", ":all:", "--require-hashes", "--requirement", str(wheels / LOCK),
    ]
    # fmt: on
    _run([sys.executable, "-I", "-m", "venv", "--without-pip", str(environment.path)], lock)
    _run([*pip, "install", *options], lock)
    os.sync()
    part = environment.path / f"{LIST}.part"
    shutil.copyfile(wheels / LIST, part)
    with part.open("rb") as file:
        os.fsync(file.fileno())
    part.replace(environment.path / LIST)


def _run(words: Sequence[str], lock: int) -> None:
    try:
        process = subprocess.run(  # noqa: S603 - fixed arguments
            words, capture_output=True, timeout=_TIMEOUT_S, check=False, stdin=subprocess.DEVNULL, pass_fds=(lock,)
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise UpdateError(f"{words[0]}: {error}") from None
    if process.returncode != 0:
        lines = (process.stderr or process.stdout).decode("utf-8", "replace").strip().splitlines()
        errors = [line for line in lines if line.startswith("ERROR:")] or lines or [f"exit code {process.returncode}"]
        raise UpdateError(f"the new environment cannot be made: {errors[0][:300]}")


def _remove(path: Path) -> None:
    """Remove a directory, its list first, so that a remnant never counts as complete."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        (path / LIST).unlink()
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
