"""The files of the service, as text with their places: systemd's unit, udev's rules, its user and its directory."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py import ROOT
from firmware_py.install.program_link import STARTS

NAME = "rambler"
PAGE = "rambler-view"  # the page of the boat under way, a service of its own
STATE = Path("/var/lib/rambler")
UNIT = Path("/etc/systemd/system/rambler.service")
PAGE_UNIT = Path("/etc/systemd/system/rambler-view.service")
TRIAL = Path("/usr/local/lib/rambler/trial")
# What is for nobody but its user, or away for a service that is kept from it (ProtectHome, PrivateTmp).
HIDDEN = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))  # noqa: S108 - they are refused
_TEMPLATES = Path(__file__).parent / "templates"
# Of a checkout, and of a built package (pyproject.toml).
_PARAMS = (ROOT / "params", Path(__file__).parents[1] / "params")


class Page(msgspec.Struct, frozen=True):
    """Where browsers find the page of the boat under way, and the file with the token that it asks for, if any."""

    listen: str
    token: Path | None = None


class Service(msgspec.Struct, frozen=True):
    """What the service runs: the program, the vehicle file, the state directory; watchdog device and page, if any."""

    program: tuple[str, ...]
    vehicle: Path
    state: Path = STATE
    watchdog: Path | None = None
    page: Page | None = None


class ServiceFile(msgspec.Struct, frozen=True):
    """One file: its place and its text."""

    path: Path
    text: str


def service_files(service: Service) -> tuple[ServiceFile, ...]:
    """Return all of them, the unit first."""
    page = () if service.page is None else (ServiceFile(PAGE_UNIT, page_unit_text(service, service.page)),)
    return (
        ServiceFile(UNIT, unit_text(service)),
        ServiceFile(Path("/etc/udev/rules.d/99-rambler.rules"), _template("rambler.rules")),
        ServiceFile(Path("/etc/sysusers.d/rambler.conf"), _template("rambler.sysusers")),
        ServiceFile(Path("/etc/tmpfiles.d/rambler.conf"), _template("rambler.tmpfiles")),
        ServiceFile(TRIAL, trial_text()),
        *page,
    )


def file_places() -> tuple[Path, ...]:
    """Return where they are."""
    return tuple(file.path for file in service_files(Service((), Path("/"), page=Page(""))))


def unit_text(service: Service) -> str:
    """Return the unit."""
    words = [*service.program, "run", str(service.vehicle), "--state", str(service.state), "--wait"]
    watchdog = ""
    if service.watchdog is not None:
        words += ["--watchdog", str(service.watchdog)]
        watchdog = f"DeviceAllow={_specifiers_escaped(str(service.watchdog))} rw\n"
    # Where it is not there at the start, it is taken up when it comes.
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
    """Return the unit of the page; its token stays with root, and is handed over at each start."""
    words = [*service.program, "view", "--state", str(service.state), "--listen", page.listen]
    token, credential = "", ""
    if page.token is not None:
        token, credential = " --token %d/token", f"LoadCredential=token:{_specifiers_escaped(str(page.token))}\n"
    text = _template("rambler-view.service").replace("@COMMAND@\n", f"{_command(words)}{token}\n")
    return text.replace("@CREDENTIAL@\n", credential)


def trial_text() -> str:
    """Return the script that counts the starts of a program on trial."""
    return _template("rambler.trial").replace("@STARTS@", str(STARTS))


def hidden(path: Path) -> bool:
    """Whether the service could not see a path."""
    return any(place == path or place in path.parents for place in HIDDEN)


def example(name: str) -> Path:
    """Return an example or a page that comes with the program; OSError when it is not there."""
    for folder in _PARAMS:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(2, "is not in this installation; install it anew", name)


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _command(words: list[str]) -> str:
    """Return a command line as systemd reads it (systemd.service(5), Command lines)."""
    return " ".join(_word(word) for word in words)


def _word(word: str) -> str:
    return _quoted(_specifiers_escaped(word).replace("$", "$$"))


def _quoted(word: str) -> str:
    escaped = word.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"' if any(character in word for character in " \t\"'\\;") else escaped


def _specifiers_escaped(text: str) -> str:
    return text.replace("%", "%%")
