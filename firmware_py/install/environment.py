"""Environments: each version of the autopilot in a directory of its own, beside that of the version in force."""

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
_MADE = re.compile(rf"{NAME}-\d.*-[0-9a-f]{{8}}")  # the names that beside() gives, and nobody by hand
_SPARE_BYTES = 50_000_000  # what the autopilot, which may share the disk, is left
_COMPILED = 1.6  # with the modules as Python compiles them
_PATIENCE_S = 1200.0
_MOST_CONFIG_BYTES, _MOST_LIST_BYTES = 1 << 16, 1 << 20


class Environment(msgspec.Struct, frozen=True):
    """One environment."""

    path: Path

    @property
    def program(self) -> Path:
        """Return the autopilot in it."""
        return self.path / "bin" / NAME

    @property
    def python(self) -> Path:
        """Return the Python in it."""
        return self.path / "bin" / "python"

    def bundle(self) -> Bundle | None:
        """Return the list of the bundle that it was wholly made of, None when it was made otherwise or not wholly."""
        try:
            return read_list(read_regular(self.path / LIST, _MOST_LIST_BYTES))
        except (OSError, UpdateError):
            return None


def environment_of(program: Path) -> Environment:
    """Return the environment of a program; UpdateError when it is in none that can be updated."""
    environment = Environment(program.parents[1])
    remedy = "install it as the handbook says (docs/how-to/installation.md)"
    try:
        text = read_text(environment.path / _CONFIG, _MOST_CONFIG_BYTES)
    except OSError:
        raise UpdateError(f"{program} is in no environment of its own: {remedy}") from None
    settings = {name.strip(): value.strip() for name, _, value in (line.partition("=") for line in text.splitlines())}
    if settings.get("include-system-site-packages") == "true":
        raise UpdateError(
            f"{environment.path} takes packages of the system, which a bundle cannot replace: make the new environment "
            "by hand (handbook, A board without wheels) and lead the link to it"
        )
    return environment


def beside(environment: Environment, bundle: Bundle) -> Environment:
    """Return where the environment of a bundle is to be: in the directory of another one, by a name of its own."""
    return Environment(environment.path.with_name(f"{NAME}-{bundle.version}-{bundle.digest[:8]}"))


def work_directory(environment: Environment) -> Path:
    """Return where an update works, on the same disk; what one that was killed has left there is removed."""
    folder = environment.path.with_name(TRIAL_DIRECTORY)
    _remove(folder)
    folder.mkdir(mode=0o700)
    return folder


def remove_others(kept: Sequence[Environment]) -> list[str]:
    """Remove what earlier updates have made beside these, finished or not, and nothing else; return the names."""
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
    """Raise UpdateError when the disk has no room for an environment of these wheels."""
    largest: dict[str, int] = {}  # one wheel of each package is taken, for this computer
    for wheel in wheels.glob("*.whl"):
        try:
            with zipfile.ZipFile(wheel) as archive:
                size = sum(info.file_size for info in archive.infolist())
        except (OSError, zipfile.BadZipFile) as error:
            raise UpdateError(f"{wheel.name} in it is no wheel: {error}; make the bundle anew") from None
        package = wheel.name.partition("-")[0]
        largest[package] = max(size, largest.get(package, 0))
    needed = int(sum(largest.values()) * _COMPILED) + _SPARE_BYTES
    free = shutil.disk_usage(environment.path.parent).free
    if free < needed:
        raise UpdateError(
            f"{environment.path.parent} has {free / 1e6:.0f} MB free, an update needs {needed / 1e6:.0f} MB: make room"
        )


def make(environment: Environment, wheels: Path, bundle: Bundle, held: int) -> None:
    """Make an environment of the wheels of a bundle, by venv and pip; UpdateError when that cannot be.

    The list of the bundle is put into it last, when everything else is on disk: without it, it is not whole. The
    programs hold on to the descriptor `held`, a lock, so that none is still at it when the next update begins.
    """
    if importlib.util.find_spec("venv") is None:
        raise UpdateError("this Python has no venv; apt-get install python3-venv")
    _remove(environment.path)
    # pip is run from its wheel: nothing of it need be on this computer, nor stays.
    pip = [str(environment.python), str(wheels / bundle.of("pip") / "pip")]
    # fmt: off
    options = [
        "--isolated", "--disable-pip-version-check", "--no-input", "--no-cache-dir", "--quiet", "--no-index",
        "--find-links", str(wheels), "--only-binary", ":all:", "--require-hashes", "--requirement", str(wheels / LOCK),
    ]
    # fmt: on
    _run([sys.executable, "-I", "-m", "venv", "--without-pip", str(environment.path)], held)
    _run([*pip, "install", *options], held)
    os.sync()
    part = environment.path / f"{LIST}.part"
    shutil.copyfile(wheels / LIST, part)
    with part.open("rb") as file:
        os.fsync(file.fileno())
    part.replace(environment.path / LIST)


def _run(words: Sequence[str], held: int) -> None:
    try:
        done = subprocess.run(  # noqa: S603 - words of our own
            words, capture_output=True, timeout=_PATIENCE_S, check=False, stdin=subprocess.DEVNULL, pass_fds=(held,)
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise UpdateError(f"{words[0]}: {error}") from None
    if done.returncode != 0:
        said = (done.stderr or done.stdout).decode("utf-8", "replace").strip().splitlines()
        wrong = [line for line in said if line.startswith("ERROR:")] or said or [f"exit code {done.returncode}"]
        raise UpdateError(f"the new environment cannot be made: {wrong[0][:300]}")


def _remove(path: Path) -> None:
    """Remove a directory; its list goes first, so that what is left of it never passes for whole."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        (path / LIST).unlink()
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
