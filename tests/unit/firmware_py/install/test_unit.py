"""Units and their drop-ins are read as systemd reads them."""

from pathlib import Path

import pytest

from firmware_py.install import unit
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import Service, build_unit
from firmware_py.install.unit import read_installation

SERVICE = Service(("/opt/rambler",), Path("/etc/boat.toml"), Path("/srv/state"), Path("/dev/watchdog"))
COMMAND = "/opt/rambler run /etc/boat.toml --state /srv/state --wait"
OTHER = COMMAND.replace("/etc/boat.toml", "/etc/other.toml")
OTHER_IN_TWO_LINES = OTHER.replace(" --state", " \\\n --state")


@pytest.fixture
def directory(tmp_path):
    """Return a directory with a unit of rambler and an empty drop-in directory."""
    (tmp_path / "a.service").write_text(build_unit(SERVICE))
    (tmp_path / "a.service.d").mkdir()
    return tmp_path


def test_unit_with_special_characters_is_parsed(tmp_path):
    service = Service(("/usr/bin/a b/rambler",), Path("/etc/per%cent/boat.toml"), Path("/srv/state dir"))
    (tmp_path / "unit").write_text(build_unit(service))
    installation = read_installation(tmp_path / "unit")
    assert (installation.link.path, installation.vehicle, installation.state) == (
        Path(service.program[0]),
        service.vehicle,
        service.state,
    )


def test_unit_is_parsed(directory):
    installation = read_installation(directory / "a.service")
    assert (installation.link.path, installation.vehicle, installation.state) == (
        Path("/opt/rambler"),
        SERVICE.vehicle,
        SERVICE.state,
    )
    assert (installation.watchdog, installation.unit) == (SERVICE.watchdog, build_unit(SERVICE))


@pytest.mark.parametrize(
    "text",
    [
        f"[Service]\nExecStart=\nExecStart={OTHER}\n",
        f"[Service]\nExecStart =\nExecStart = -{OTHER}\nNice=-5\n",
        f"# ExecStart=/bin/false \\\n[Service]\nExecStart=\nExecStart={OTHER_IN_TWO_LINES}\n",
        f"[Service]\nExecStart=\nExecStart={OTHER} --watchdog\\",
    ],
)
def test_drop_in_overrides_the_unit(directory, text):
    (directory / "a.service.d/override.conf").write_text(text)
    installation = read_installation(directory / "a.service")
    assert (installation.vehicle, installation.state, installation.watchdog) == (
        Path("/etc/other.toml"),
        SERVICE.state,
        None,
    )


def test_last_drop_in_applies_unless_it_is_masked(directory, tmp_path, monkeypatch):
    monkeypatch.setattr(unit, "UNIT", directory / "a.service")
    monkeypatch.setattr(unit, "_UNIT_DIRECTORIES", (directory, tmp_path / "run"))
    (tmp_path / "run/a.service.d").mkdir(parents=True)
    for unit_directory, name, vehicle in (
        (directory, "10-a.conf", "first"),
        (tmp_path / "run", "10-a.conf", "hidden"),
        (tmp_path / "run", "20-b.conf", "last"),
    ):
        command = COMMAND.replace("/etc/boat.toml", f"/etc/{vehicle}.toml")
        (unit_directory / "a.service.d" / name).write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    assert read_installation(directory / "a.service").vehicle == Path("/etc/last.toml")
    (directory / "a.service.d/20-b.conf").symlink_to("/dev/null")  # masks the drop-in
    assert read_installation(directory / "a.service").vehicle == Path("/etc/first.toml")


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (COMMAND.replace("/srv/state", "/srv/other"), "runs /opt/rambler on /srv/other, but the starts of a trial"),
        (COMMAND.replace("/opt/", "/usr/"), "runs /usr/rambler on /srv/state, but the starts of a trial"),
        (COMMAND, ""),
    ],
)
def test_drop_in_without_matching_trial_blocks_updates(directory, command, text):
    (directory / "a.service.d/override.conf").write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    installation = read_installation(directory / "a.service")
    assert str(installation.state) in command
    assert text in installation.blocked_reason
    assert bool(installation.blocked_reason) is bool(text)


@pytest.mark.parametrize(
    "text",
    [
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '%S/rambler')}",
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '${STATE}')}",
        "ExecStart=\nExecStart=/opt/rambler run /etc/boat.toml --state",
        "ExecStartPre=",
        "ExecStartPre=/usr/local/lib/rambler/trial /opt/rambler /srv/state",
        "ExecStart=",
    ],
)
def test_drop_in_with_another_command_is_refused(directory, text):
    (directory / "a.service.d/override.conf").write_text(f"[Service]\n{text}\n")
    with pytest.raises(UpdateError, match="not a current unit"):
        read_installation(directory / "a.service")


def test_unreadable_drop_in_is_refused(directory):
    (directory / "a.service.d/override.conf").symlink_to(directory / "gone")
    with pytest.raises(UpdateError, match=r"override\.conf: No such file"):
        read_installation(directory / "a.service")
    (directory / "gone").write_text("#" * ((1 << 18) + 1))
    with pytest.raises(UpdateError, match=r"override\.conf: is larger than 256 KiB"):
        read_installation(directory / "a.service")
