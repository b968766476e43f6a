"""The unit and its drop-ins are read as systemd reads them."""

from pathlib import Path

import pytest

from firmware_py.install import unit
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import Service, unit_text
from firmware_py.install.unit import installation_of

SERVICE = Service(("/opt/rambler",), Path("/etc/boat.toml"), Path("/srv/state"), Path("/dev/watchdog"))
COMMAND = "/opt/rambler run /etc/boat.toml --state /srv/state --wait"
OTHER = COMMAND.replace("/etc/boat.toml", "/etc/other.toml")


@pytest.fixture
def place(tmp_path):
    """A directory with a unit of rambler and an empty drop-in directory."""
    (tmp_path / "a.service").write_text(unit_text(SERVICE))
    (tmp_path / "a.service.d").mkdir()
    return tmp_path


def test_unit_with_special_characters_is_parsed(tmp_path):
    service = Service(("/usr/bin/a b/rambler",), Path("/etc/per%cent/boat.toml"), Path("/srv/state dir"))
    (tmp_path / "unit").write_text(unit_text(service))
    found = installation_of(tmp_path / "unit")
    assert (found.link.path, found.vehicle, found.state) == (Path(service.program[0]), service.vehicle, service.state)


def test_unit_is_parsed(place):
    found = installation_of(place / "a.service")
    assert (found.link.path, found.vehicle, found.state) == (Path("/opt/rambler"), SERVICE.vehicle, SERVICE.state)
    assert (found.watchdog, found.unit) == (SERVICE.watchdog, unit_text(SERVICE))


@pytest.mark.parametrize(
    "text",
    [
        f"[Service]\nExecStart=\nExecStart={OTHER}\n",
        f"[Service]\nExecStart =\nExecStart = -{OTHER}\nNice=-5\n",
        "# ExecStart=/bin/false \\\n[Service]\nExecStart=\nExecStart="
        + OTHER.replace(" --state", " \\\n --state")
        + "\n",
    ],
)
def test_drop_in_overrides_the_unit(place, text):
    (place / "a.service.d/override.conf").write_text(text)
    found = installation_of(place / "a.service")
    assert (found.vehicle, found.state, found.watchdog) == (Path("/etc/other.toml"), SERVICE.state, None)


def test_drop_in_order_and_masking(place, tmp_path, monkeypatch):
    monkeypatch.setattr(unit, "UNIT", place / "a.service")
    monkeypatch.setattr(unit, "_PLACES", (place, tmp_path / "run"))
    (tmp_path / "run/a.service.d").mkdir(parents=True)
    for where, name, vehicle in (
        (place, "10-a.conf", "first"),
        (tmp_path / "run", "10-a.conf", "hidden"),
        (tmp_path / "run", "20-b.conf", "last"),
    ):
        command = COMMAND.replace("/etc/boat.toml", f"/etc/{vehicle}.toml")
        (where / "a.service.d" / name).write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    assert installation_of(place / "a.service").vehicle == Path("/etc/last.toml")
    (place / "a.service.d/20-b.conf").symlink_to("/dev/null")  # how one is switched off
    assert installation_of(place / "a.service").vehicle == Path("/etc/first.toml")


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (COMMAND.replace("/srv/state", "/srv/other"), "runs /opt/rambler on /srv/other, but the starts of a trial"),
        (COMMAND.replace("/opt/", "/usr/"), "runs /usr/rambler on /srv/state, but the starts of a trial"),
        (COMMAND, ""),
    ],
)
def test_drop_in_without_matching_trial_blocks_updates(place, command, text):
    (place / "a.service.d/override.conf").write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    found = installation_of(place / "a.service")
    assert str(found.state) in command
    assert (text in found.blocked_reason, bool(found.blocked_reason)) == (True, bool(text))


@pytest.mark.parametrize(
    "text",
    [
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '%S/rambler')}",
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '${STATE}')}",
        "ExecStartPre=",
        "ExecStart=",
    ],
)
def test_drop_in_with_another_command_is_refused(place, text):
    (place / "a.service.d/override.conf").write_text(f"[Service]\n{text}\n")
    with pytest.raises(UpdateError, match="not a current unit"):
        installation_of(place / "a.service")


def test_unreadable_drop_in_is_refused(place):
    (place / "a.service.d/override.conf").symlink_to(place / "gone")
    with pytest.raises(UpdateError, match=r"override\.conf: No such file"):
        installation_of(place / "a.service")
