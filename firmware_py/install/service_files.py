"""Paths and texts of the files of the service: systemd units, udev rules, user, directory, start script."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py import ROOT
from firmware_py.install.program_link import STARTS

SERVICE_NAME = "rambler"  # also the name of its user and of its program
PAGE_SERVICE_NAME = "rambler-view"  # of the live page
STATE = Path("/var/lib/rambler")
UNIT = Path("/etc/systemd/system/rambler.service")
PAGE_UNIT = Path("/etc/systemd/system/rambler-view.service")
TRIAL = Path("/usr/local/lib/rambler/trial")  # the start script
# Directories that the service cannot access (ProtectHome, PrivateTmp).
HIDDEN_DIRECTORIES = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))  # noqa: S108 - these are refused
_TEMPLATES = Path(__file__).parent / "templates"
# In a checkout, and in an installed package (pyproject.toml).
_PARAMS_DIRECTORIES = (ROOT / "params", Path(__file__).parents[1] / "params")


class Page(msgspec.Struct, frozen=True):
    """Address of the live page, and its token file (None: without a token)."""

    listen: str
    token: Path | None = None


class Service(msgspec.Struct, frozen=True):
    """Program, vehicle file and state directory of the service; optionally watchdog device and live page."""

    program: tuple[str, ...]
    vehicle: Path
    state: Path = STATE
    watchdog: Path | None = None
    page: Page | None = None


class ServiceFile(msgspec.Struct, frozen=True):
    """A file of the service."""

    path: Path
    text: str


def service_files(service: Service) -> tuple[ServiceFile, ...]:
    """Return the files of a service, the unit first."""
    page = () if service.page is None else (ServiceFile(PAGE_UNIT, build_page_unit(service, service.page)),)
    return (
        ServiceFile(UNIT, build_unit(service)),
        ServiceFile(Path("/etc/udev/rules.d/99-rambler.rules"), _read_template("rambler.rules")),
        ServiceFile(Path("/etc/sysusers.d/rambler.conf"), _read_template("rambler.sysusers")),
        ServiceFile(Path("/etc/tmpfiles.d/rambler.conf"), _read_template("rambler.tmpfiles")),
        ServiceFile(TRIAL, build_trial_script()),
        *page,
    )


def file_paths() -> tuple[Path, ...]:
    """Return the paths of all files that any service may have."""
    return tuple(file.path for file in service_files(Service((), Path("/"), page=Page(""))))


def build_unit(service: Service) -> str:
    """Return the text of the unit of a service."""
    command = [*service.program, "run", str(service.vehicle), "--state", str(service.state), "--wait"]
    watchdog = ""
    if service.watchdog is not None:
        command += ["--watchdog", str(service.watchdog)]
        watchdog = f"DeviceAllow={_escape_specifiers(str(service.watchdog))} rw\n"
    # With a leading `-`, the directory need not exist at the start.
    is_outside = service.state != STATE and STATE not in service.state.parents
    writable_line = f"ReadWritePaths={_quote(_escape_specifiers(f'-{service.state}'))}\n" if is_outside else ""
    text = _read_template("rambler.service")
    for placeholder, value in (
        ("@COMMAND@\n", f"{_join_command(command)}\n"),
        ("@TRIAL@\n", f"{_join_command([str(TRIAL), command[0], str(service.state)])}\n"),
        ("@WRITABLE@\n", writable_line),
        ("@WATCHDOG@\n", watchdog),
    ):
        text = text.replace(placeholder, value)
    return text


def build_page_unit(service: Service, page: Page) -> str:
    """Return the text of the unit of the live page; systemd passes the token, whose file only root can read."""
    command = [*service.program, "view", "--state", str(service.state), "--listen", page.listen]
    token, credential = "", ""
    if page.token is not None:
        token, credential = " --token %d/token", f"LoadCredential=token:{_escape_specifiers(str(page.token))}\n"
    text = _read_template("rambler-view.service").replace("@COMMAND@\n", f"{_join_command(command)}{token}\n")
    return text.replace("@CREDENTIAL@\n", credential)


def build_trial_script() -> str:
    """Return the script that counts the starts of a program on trial."""
    return _read_template("rambler.trial").replace("@STARTS@", str(STARTS))


def is_hidden(path: Path) -> bool:
    """Return whether the service cannot access a path."""
    return any(directory == path or directory in path.parents for directory in HIDDEN_DIRECTORIES)


def example(name: str) -> Path:
    """Return the path of an example or page of the package; raise OSError if it is missing."""
    for folder in _PARAMS_DIRECTORIES:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(2, "is missing in this installation; reinstall", name)


def _read_template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _join_command(command: list[str]) -> str:
    """Return a command line in the syntax of systemd.service(5)."""
    return " ".join(_escape_argument(argument) for argument in command)


def _escape_argument(argument: str) -> str:
    return _quote(_escape_specifiers(argument).replace("$", "$$"))


def _quote(argument: str) -> str:
    escaped = argument.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"' if any(character in argument for character in " \t\"'\\;") else escaped


def _escape_specifiers(text: str) -> str:
    return text.replace("%", "%%")
