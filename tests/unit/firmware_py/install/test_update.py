"""Updates: refusals, checks and trials."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from firmware_py import COMMIT_FILE, __version__
from firmware_py.__main__ import main
from firmware_py.install import environment, update
from firmware_py.install.bundle import UpdateError
from firmware_py.install.environment import Environment, check_room
from firmware_py.install.program_link import UPDATE_FILE, passed_text
from firmware_py.install.self_check import CHECKS, Candidate, dry_text, printed_unit, self_check
from firmware_py.install.service_files import Service, unit_text
from firmware_py.install.unit import installation_of
from firmware_py.system.clock import machine_s
from firmware_py.system.status_file import DIRECTORIES, file_name
from firmware_py.system.store import Store
from support.killed_update import begin, build
from support.small_bundle import small_bundle


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A tree of small programs in which an update succeeds."""
    begin(tmp_path / "place", small_bundle(tmp_path))
    monkeypatch.setattr(environment, "_run", build)
    monkeypatch.setattr(environment, "check_room", lambda *_: None)
    monkeypatch.setattr(update, "self_check", lambda _candidate: iter(["tried"]))
    monkeypatch.setattr("firmware_py.cli.update.await_trial", lambda *_: True)
    yield tmp_path / "place"
    for directory in DIRECTORIES:
        (directory / file_name(tmp_path / "place/state")).unlink(missing_ok=True)


@pytest.fixture
def ask(place, capsys):
    """Run `rambler update` in the tree; return exit code and output."""

    def run(*words):
        words = words or (str(place / "new.bundle"),)
        code = main(["update", *words, "--unit", str(place / "rambler.service")])
        output = capsys.readouterr()
        return code, output.err or output.out

    return run


def in_force(place):
    return (place / "bin/rambler").resolve().parents[1].name


def says(place, **status):
    """Write a status file of an autopilot."""
    whole = {"written_machine_s": machine_s(), "pid": os.getpid(), "state_directory": str(place / "state"), **status}
    (DIRECTORIES[1] / file_name(place / "state")).write_text(json.dumps(whole))


def test_update_roll_back_and_update(place, ask):
    code, output = ask()
    assert code == 0
    assert "9.9.9 (git abcd1234), hashes correct" in output
    assert "on trial for 3 starts" in output
    forward = in_force(place)
    assert forward.startswith("rambler-9.9.9-")
    assert "is on trial (0 starts so far)" in ask()[1]
    assert ask("--back")[0] == 0
    assert in_force(place) == "rambler"
    (place / "bin/.rambler.trial").unlink()
    assert ask()[0] == 0
    assert in_force(place) == forward


def test_roll_back_needs_a_previous_version_and_an_update_another_one(place, ask):
    assert ask("--back") == (2, "rambler update: there is no previous version\n")
    ask()
    (place / "bin/.rambler.trial").unlink()
    assert ask() == (2, "rambler update: 9.9.9 (git abcd1234) is already installed\n")


def test_armed_boat_with_state_from_drop_in_is_not_updated(place, ask):
    """The unit alone names a state directory without a running autopilot."""
    says(place, armed=True)
    unit = place / "rambler.service"
    unit.write_text(unit.read_text().replace(str(place / "state"), str(place / "other")))
    (place / "rambler.service.d").mkdir()
    command = f"{place / 'bin/rambler'} run {place / 'boat.toml'} --state {place / 'state'} --wait"
    (place / "rambler.service.d/override.conf").write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    code, output = ask()
    assert (code, in_force(place)) == (2, "rambler")
    assert f"override.conf runs {place / 'bin/rambler'} on {place / 'state'}" in output


def test_disarmed_boat_is_updated(place, ask):
    says(place, armed=False)
    assert ask()[0] == 0


def test_armed_boat_is_updated_only_with_armed(place, ask):
    says(place, armed=True)
    code, output = ask()
    assert (code, in_force(place)) == (2, "rambler")
    assert "the boat is armed; disarm it, or use --armed" in output
    code, output = ask(str(place / "new.bundle"), "--armed")
    assert code == 0
    assert "no autopilot runs; the next start" in output, "whose number is in the status is no autopilot of this link"


@pytest.mark.parametrize("status", [{}, {"armed": False, "written_machine_s": 1.0}, {"armed": False, "pid": 2**22 + 1}])
def test_unknown_arming_state_counts_as_armed(place, ask, status):
    says(place, **status)
    code, output = ask()
    assert (code, in_force(place)) == (2, "rambler")
    assert "--armed" in output


@pytest.mark.parametrize("words", [(), ("--back",)])
def test_arming_during_the_checks_stops_the_update(place, ask, monkeypatch, words):
    if words:
        ask()
    before = in_force(place)

    def armed(*_):
        says(place, armed=True)
        return iter(["tried"])

    monkeypatch.setattr(update, "self_check", armed)
    monkeypatch.setattr(update.os, "access", lambda *_: bool(armed()))
    code, output = ask(*words)
    assert (code, in_force(place)) == (2, before)
    assert "the boat is armed; disarm it" in output


def test_downgrade_needs_older(place, ask, tmp_path):
    older = small_bundle(tmp_path, version="0.0.1")
    code, output = ask(str(older))
    assert (code, in_force(place)) == (2, "rambler")
    assert f"0.0.1 (git abcd1234) is older than the installed {__version__}" in output
    code, output = ask(str(older), "--older")
    assert code == 0
    assert "is older than" in output


def test_same_version_is_compared_by_commit_time(place, ask, tmp_path, monkeypatch):
    monkeypatch.setattr(update, "ROOT", tmp_path)
    (tmp_path / "firmware_py").mkdir()
    (tmp_path / COMMIT_FILE).write_text("89abcdef\n1001\n")
    same = str(small_bundle(tmp_path, version=__version__))
    text = f"{__version__} (git abcd1234) is older than the installed {__version__} (git 89abcdef)"
    assert text in ask(same)[1]
    assert in_force(place) == "rambler"
    code, output = ask(same, "--older")
    assert (code, text in output) == (0, True)


@pytest.mark.parametrize("dangling", [False, True])
def test_signers_require_a_signature(place, ask, monkeypatch, dangling):
    if dangling:
        (place / "signers").symlink_to(place / "gone")
    else:
        (place / "signers").write_text("")
    monkeypatch.setattr("firmware_py.cli.update.SIGNERS", place / "signers")
    for words in ((), (str(place / "new.bundle"), "--signers", str(place / "signers"))):
        code, output = ask(*words)
        assert (code, in_force(place), "not signed" in output) == (2, "rambler", True)


def test_one_update_at_a_time(place, ask):
    link = installation_of(place / "rambler.service").link
    with update._locked(link):
        assert ask() == (2, "rambler update: another update is running; wait for its end\n")


def test_only_environments_of_updates_are_removed(place, ask):
    made, by_hand = "rambler-0.1.0.dev0-0123abcd", ("rambler-new", "rambler-hil", "rambler-2-of-mine")
    for name in (made, *by_hand):
        shutil.copytree(place / "opt/rambler", place / "opt" / name)
    code, output = ask()
    assert code == 0
    assert f"removed {made} of an earlier update" in output
    assert {path.name for path in (place / "opt").iterdir()} == {"rambler", *by_hand, in_force(place)}


def test_closed_terminal_does_not_interrupt_an_update(place, monkeypatch):
    """The running program is ended although output fails after the switch."""
    text = []
    monkeypatch.setattr(update, "_is_autopilot", lambda *_: True)
    monkeypatch.setattr(os, "kill", lambda pid, number: text.append(number))
    says(place, armed=False)

    def gone(*_words, **_more):
        if in_force(place) != "rambler":
            raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("builtins.print", gone)
    words = ["update", str(place / "new.bundle"), "--unit", str(place / "rambler.service")]
    assert main(words) == 0
    assert signal.SIGTERM in text


def test_failed_check_leaves_no_files(place, ask, monkeypatch):
    def fails(_candidate):
        yield "tried"
        raise UpdateError("it does not start: no")

    monkeypatch.setattr(update, "self_check", fails)
    assert ask() == (2, "rambler update: it does not start: no\n")
    assert [path.name for path in (place / "opt").iterdir()] == ["rambler"]
    assert [path.name for path in (place / "bin").iterdir()] == ["rambler"]


def test_invalid_or_missing_bundle_is_refused(place, ask):
    (place / "text").write_text("hello")
    assert "not a bundle" in ask(str(place / "text"))[1]
    os.mkfifo(place / "pipe")
    for path, text in ((place / "pipe", "is a pipe"), (Path("/dev/zero"), "is a device"), (place, "Is a directory")):
        code, output = ask(str(path))
        assert (code, output.startswith(f"rambler update: {path}: {text}")) == (2, True), output
    assert ask(str(place / "nothing"))[0] == 2


def edit(path, old, new):
    path.write_text(path.read_text().replace(old, new))


def replace_link(place):
    (place / "bin/rambler").unlink()
    shutil.copy(place / "opt/rambler/bin/rambler", place / "bin/rambler")


UNIT, CONFIG = "rambler.service", "opt/rambler/pyvenv.cfg"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda place: edit(place / UNIT, "ExecStartPre", "#"), "is not a current unit"),
        (lambda place: edit(place / UNIT, " run ", " walk "), "is not a current unit"),
        (lambda place: edit(place / UNIT, "ExecStart=", 'ExecStart="'), "is not a current unit"),
        (lambda place: (place / UNIT).unlink(), "only a service can be updated"),
        (replace_link, "is not a link"),
        (lambda place: (place / CONFIG).write_text("include-system-site-packages = true\n"), "A board without wheels"),
        (lambda place: (place / CONFIG).unlink(), "is not in a virtual environment"),
    ],
    ids=["no trial", "other command", "open quote", "no unit", "no link", "system packages", "no environment"],
)
def test_unsuitable_installation_is_refused(place, ask, change, text):
    change(place)
    code, output = ask()
    assert (code, text in output) == (2, True), output


def test_update_needs_free_space(tmp_path, monkeypatch):
    (tmp_path / "wheels").mkdir()
    wheel = shutil.make_archive(str(tmp_path / "wheel"), "zip", tmp_path, "wheels")
    shutil.move(wheel, tmp_path / "wheels/a-1-py3-none-any.whl")
    check_room(Environment(tmp_path / "rambler"), tmp_path / "wheels")
    monkeypatch.setattr(environment, "_RESERVE_BYTES", 10**15)
    with pytest.raises(UpdateError, match="free space"):
        check_room(Environment(tmp_path / "rambler"), tmp_path / "wheels")


def test_end_of_a_trial_is_reported(place, ask):
    installation, output = installation_of(place / "rambler.service"), []
    ask()
    program = installation.link.target()
    store = Store(place / "state")
    store.save(UPDATE_FILE, passed_text(program).encode())
    store.close()
    assert update.await_trial(installation, output.append)
    assert installation.link.trial() is None
    for slot in (place / "state").glob(f"{UPDATE_FILE}.*"):
        slot.unlink()
    assert update.await_trial(installation, output.append), "the service has ended it"
    ask("--back")
    (place / "bin/.rambler.before").replace(place / "bin/rambler")
    (place / "bin/.rambler.trial").replace(place / "bin/.rambler.failed")
    assert not update.await_trial(installation, output.append)
    assert output[:2] == ["trial passed: the new version stays", "trial passed before: the version stays"]
    assert output[2].startswith("rolled back: rambler has not passed its trial in 0 starts")


def test_trial_passed_unobserved_allows_the_next_update(place, ask, tmp_path):
    """The next start of the service removes such a trial, which may be months later."""
    ask()
    store = Store(place / "state")
    store.save(UPDATE_FILE, passed_text(installation_of(place / "rambler.service").link.target()).encode())
    store.close()
    code, output = ask(str(small_bundle(tmp_path, version="9.9.10")))
    assert (code, in_force(place).startswith("rambler-9.9.10-")) == (0, True), output


def test_version_that_has_passed_needs_no_trial(place, ask):
    old = installation_of(place / "rambler.service").link.target()
    store = Store(place / "state")
    store.save(UPDATE_FILE, passed_text(old).encode())
    store.close()
    assert "on trial for 3 starts" in ask()[1]
    code, output = ask("--back")
    assert code == 0
    assert f"points to {old}\n" in output
    assert "on trial" not in output


VEHICLE = """
[compass]
driver = "nmea"
port = "/dev/ttyUSB0"
baud = 4800
[position]
driver = "nmea"
port = "/dev/ttyUSB0"
baud = 4800
[rudder]
driver = "volz"
port = "/dev/tty \\"odd\\""
baud = 115200
[link]
urls = ["udpin:127.0.0.1:14550"]
[parameters]
file = "more.param"
CTL_K1 = 30.5
"""


def test_checks_use_no_real_ports_or_links(tmp_path):
    (tmp_path / "boat.toml").write_text(VEHICLE)
    (work := tmp_path / "work").mkdir()
    dry = tomllib.loads(dry_text(tmp_path / "boat.toml", work))
    assert "link" not in dry
    assert dry["compass"]["port"] == dry["position"]["port"] == str(work / "port0")
    assert dry["rudder"]["port"] == str(work / "port1")
    assert dry["parameters"] == {"file": str(tmp_path / "more.param"), "CTL_K1": 30.5}
    (tmp_path / "boat.toml").write_text("[")
    with pytest.raises(UpdateError, match=r"boat\.toml"):
        dry_text(tmp_path / "boat.toml", work)


def test_checks_use_a_copy_of_the_state(tmp_path, monkeypatch):
    for name in ("state", "work", "state/logs"):
        (tmp_path / name).mkdir()
    for name in ("parameters.param.0", "signing.key.1", "lock", "logs/00000001.BIN"):
        (tmp_path / "state" / name).write_text(name)
    (tmp_path / "boat.toml").write_text(VEHICLE)
    candidate = Candidate(
        Environment(tmp_path / "new"), None, tmp_path / "boat.toml", tmp_path / "state", tmp_path / "work"
    )
    for name in CHECKS:
        monkeypatch.setitem(CHECKS, name, lambda _candidate: "good")
    assert list(self_check(candidate)) == [f"{name}: good" for name in CHECKS]
    copies = {path.name: path for path in candidate.copy.iterdir()}
    assert set(copies) == {"parameters.param.0", "signing.key.1"}
    assert copies["signing.key.1"].stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("output", "text"),
    [
        ("9 ticks, 4 recomputed\n1 damaged ticks, 3 unreadable bytes\nNOT identical\n", "is incomplete: 9 ticks"),
        ("9 ticks, 9 recomputed\n3 commands differ, the first at\nNOT identical\n", "steers differently"),
        ("", None),  # it has failed
    ],
)
def test_damaged_or_different_log_does_not_prevent_an_update(tmp_path, monkeypatch, output, text):
    (tmp_path / "state/logs").mkdir(parents=True)
    (tmp_path / "state/logs/00000001.BIN").touch()
    done = subprocess.CompletedProcess([], 1, output, "Traceback" if text is None else "")
    monkeypatch.setattr("firmware_py.install.self_check._run", lambda *_: done)
    candidate = Candidate(Environment(tmp_path), None, tmp_path / "boat.toml", tmp_path / "state", tmp_path)
    if text is None:
        with pytest.raises(UpdateError, match="cannot replay"):
            CHECKS["newest log"](candidate)
    else:
        assert text in CHECKS["newest log"](candidate)


def test_changed_unit_is_reported(place, ask, monkeypatch):
    installed = installation_of(place / "rambler.service").unit
    monkeypatch.setattr(update, "printed_unit", lambda _program, _words: installed)
    assert "another service unit" not in ask()[1]
    (place / "bin/.rambler.trial").unlink()
    asked_for = []

    def printed(program, words):
        asked_for.append((program.parents[1].name, words))
        return installed.replace("WatchdogSec=5", "WatchdogSec=4")

    monkeypatch.setattr(update, "printed_unit", printed)
    words = [str(place / "boat.toml"), "--state", str(place / "state")]
    assert f"after the trial: sudo rambler service install {' '.join(words)}" in ask("--back")[1]
    assert asked_for == [("rambler", [*words, "--program", str(place / "bin/rambler")])]


def test_unit_of_a_version_is_its_output(tmp_path):
    program = tmp_path / "rambler"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m firmware_py "$@"\n')
    program.chmod(0o755)
    service = Service(("/opt/rambler",), Path("/etc/boat.toml"), Path("/srv/state"), Path("/dev/watchdog"))
    words = ["/etc/boat.toml", "--state", "/srv/state", "--watchdog", "/dev/watchdog", "--program", "/opt/rambler"]
    assert printed_unit(program, words) == unit_text(service)
    program.write_text("#!/bin/sh\necho no\n")
    assert printed_unit(program, words) is None
    assert printed_unit(tmp_path / "gone", words) is None
