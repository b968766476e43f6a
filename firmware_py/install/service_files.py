"""Paths and texts of the service files: systemd unit, udev rules, user and directory."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py import ROOT
from firmware_py.install.program_link import STARTS

NAME = "rambler"
PAGE = "rambler-view"  # the service of the live page
STATE = Path("/var/lib/rambler")
UNIT = Path("/etc/systemd/system/rambler.service")
PAGE_UNIT = Path("/etc/systemd/system/rambler-view.service")
TRIAL = Path("/usr/local/lib/rambler/trial")
# Directories that the service cannot see (ProtectHome, PrivateTmp).
HIDDEN = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))  # noqa: S108 - these are refused
_TEMPLATES = Path(__file__).parent / "templates"
# In a checkout, and in an installed package (pyproject.toml).
_PARAMS = (ROOT / "params", Path(__file__).parents[1] / "params")


class Page(msgspec.Struct, frozen=True):
    """Address of the live page, and its token file if there is one."""

    listen: str
    token: Path | None = None


class Service(msgspec.Struct, frozen=True):
    """Program, vehicle file and state directory of the service; watchdog device and live page if there are any."""

    program: tuple[str, ...]
    vehicle: Path
    state: Path = STATE
    watchdog: Path | None = None
    page: Page | None = None


class ServiceFile(msgspec.Struct, frozen=True):
    """One file: path and text."""

    path: Path
    text: str


def service_files(service: Service) -> tuple[ServiceFile, ...]:
    """Return all files, the unit first."""
    page = () if service.page is None else (ServiceFile(PAGE_UNIT, page_unit_text(service, service.page)),)
    return (
        ServiceFile(UNIT, unit_text(service)),
        ServiceFile(Path("/etc/udev/rules.d/99-rambler.rules"), _template("rambler.rules")),
        ServiceFile(Path("/etc/sysusers.d/rambler.conf"), _template("rambler.sysusers")),
        ServiceFile(Path("/etc/tmpfiles.d/rambler.conf"), _template("rambler.tmpfiles")),
        ServiceFile(TRIAL, trial_text()),
        *page,
    )


def file_paths() -> tuple[Path, ...]:
    """Return the paths of all files."""
    return tuple(file.path for file in service_files(Service((), Path("/"), page=Page(""))))


def unit_text(service: Service) -> str:
    """Return the text of the unit."""
    words = [*service.program, "run", str(service.vehicle), "--state", str(service.state), "--wait"]
    watchdog = ""
    if service.watchdog is not None:
        words += ["--watchdog", str(service.watchdog)]
        watchdog = f"DeviceAllow={_specifiers_escaped(str(service.watchdog))} rw\n"
    # The leading `-`: the directory may appear after the start.
    elsewhere = service.state != STATE and STATE not in service.state.parents
    writable = f"ReadWritePaths={_quoted(_specifiers_escaped(f'-{service.state}'))}\n" if elsewhere else ""
    text = _template("rambler.service")
    for mark, value in (
        ("@COMMAND@\n", f"{_command(words)}\n"),
        ("@TRIAL@\n", f"{_command([str(TRIAL), words[0], str(service.state)])}\n"),
        ("@WRITABLE@\n", writable),
        ("@WATCHDOG@\n", watchdog),
    ):
        text = text.replace(mark, value)
    return text


def page_unit_text(service: Service, page: Page) -> str:
    """Return the unit of the live page; systemd passes the token, which only root can read, at each start."""
    words = [*service.program, "view", "--state", str(service.state), "--listen", page.listen]
    token, credential = "", ""
    if page.token is not None:
        token, credential = " --token %d/token", f"LoadCredential=token:{_specifiers_escaped(str(page.token))}\n"
    text = _template("rambler-view.service").replace("@COMMAND@\n", f"{_command(words)}{token}\n")
    return text.replace("@CREDENTIAL@\n", credential)


def trial_text() -> str:
    """Return the script that counts the starts of a program on trial."""
    return _template("rambler.trial").replace("@STARTS@", str(STARTS))


def is_hidden(path: Path) -> bool:
    """Return whether a path is invisible to the service."""
    return any(directory == path or directory in path.parents for directory in HIDDEN)


def example(name: str) -> Path:
    """Return the path of an example or page of the package; raise OSError if it is missing."""
    for folder in _PARAMS:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(2, "is missing in this installation; reinstall", name)


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _command(words: list[str]) -> str:
    """Return a command line in the syntax of systemd.service(5)."""
    return " ".join(_word(word) for word in words)


def _word(word: str) -> str:
    return _quoted(_specifiers_escaped(word).replace("$", "$$"))


def _quoted(word: str) -> str:
    escaped = word.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"' if any(character in word for character in " \t\"'\\;") else escaped


def _specifiers_escaped(text: str) -> str:
    return text.replace("%", "%%")
