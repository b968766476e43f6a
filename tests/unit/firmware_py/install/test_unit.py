"""What the unit of the service runs is read as systemd reads it, drop-ins included."""

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
    """A place of units with one of ours, and an empty directory for its drop-ins."""
    (tmp_path / "a.service").write_text(unit_text(SERVICE))
    (tmp_path / "a.service.d").mkdir()
    return tmp_path


def test_the_unit_says_what_runs(tmp_path):
    service = Service(("/usr/bin/a b/rambler",), Path("/etc/per%cent/boat.toml"), Path("/srv/state dir"))
    (tmp_path / "unit").write_text(unit_text(service))
    found = installation_of(tmp_path / "unit")
    assert (found.link.path, found.vehicle, found.state) == (Path(service.program[0]), service.vehicle, service.state)


def test_a_unit_tells_what_its_service_runs(place):
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
def test_a_drop_in_counts(place, text):
    (place / "a.service.d/override.conf").write_text(text)
    found = installation_of(place / "a.service")
    assert (found.vehicle, found.state, found.watchdog) == (Path("/etc/other.toml"), SERVICE.state, None)


def test_the_last_drop_in_by_name_counts_and_one_of_the_administrator_hides_one_of_the_same_name(
    place, tmp_path, monkeypatch
):
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
    ("command", "told"),
    [
        (COMMAND.replace("/srv/state", "/srv/other"), "runs /opt/rambler on /srv/other, but the starts of a trial"),
        (COMMAND.replace("/opt/", "/usr/"), "runs /usr/rambler on /srv/state, but the starts of a trial"),
        (COMMAND, ""),
    ],
)
def test_a_drop_in_that_no_trial_would_fit_is_told_and_what_it_runs(place, command, told):
    (place / "a.service.d/override.conf").write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    found = installation_of(place / "a.service")
    assert (str(found.state) in command, told in found.blocked_reason, bool(found.blocked_reason)) == (
        True,
        True,
        bool(told),
    )


@pytest.mark.parametrize(
    "text",
    [
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '%S/rambler')}",
        f"ExecStart=\nExecStart={COMMAND.replace('/srv/state', '${STATE}')}",
        "ExecStartPre=",
        "ExecStart=",
    ],
)
def test_a_drop_in_that_makes_it_no_service_of_ours_is_refused(place, text):
    (place / "a.service.d/override.conf").write_text(f"[Service]\n{text}\n")
    with pytest.raises(UpdateError, match="not a current unit"):
        installation_of(place / "a.service")


def test_a_drop_in_that_cannot_be_read_is_refused(place):
    (place / "a.service.d/override.conf").symlink_to(place / "gone")
    with pytest.raises(UpdateError, match=r"override\.conf: No such file"):
        installation_of(place / "a.service")
