"""Updates: refusals, checks and trials."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py import COMMIT_FILE, __version__
from firmware_py.__main__ import main
from firmware_py.install import environment, update
from firmware_py.install.bundle import UpdateError
from firmware_py.install.environment import Environment
from firmware_py.install.program_link import UPDATE_FILE, passed_line
from firmware_py.install.self_check import CHECKS, Candidate, read_printed_unit, self_check, vehicle_text_without_ports
from firmware_py.install.service_files import UNIT as UNIT_PATH
from firmware_py.install.service_files import Service, build_unit
from firmware_py.install.unit import read_installation
from firmware_py.system.clock import machine_s
from firmware_py.system.status_file import DIRECTORIES, file_name
from firmware_py.system.store import Store
from support.killed_update import begin, build
from support.small_bundle import small_bundle


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Return a directory of small programs in which an update succeeds."""
    begin(tmp_path / "place", small_bundle(tmp_path))
    monkeypatch.setattr(environment, "_run", build)
    monkeypatch.setattr(environment, "check_free_space", lambda *_: None)
    monkeypatch.setattr(update, "self_check", lambda _candidate: iter(["tried"]))
    monkeypatch.setattr("firmware_py.cli.update.await_trial", lambda *_: True)
    yield tmp_path / "place"
    for directory in DIRECTORIES:
        (directory / file_name(tmp_path / "place/state")).unlink(missing_ok=True)


@pytest.fixture
def run_update(tree, capsys):
    """Run `rambler update` in the tree; return exit code and output."""

    def run(*arguments):
        arguments = arguments or (str(tree / "new.bundle"),)
        code = main(["update", *arguments, "--unit", str(tree / "rambler.service")])
        output = capsys.readouterr()
        return code, output.err or output.out

    return run


def installed_name(tree):
    return (tree / "bin/rambler").resolve().parents[1].name


def write_status(tree, **status):
    """Write a status file of an autopilot."""
    content = {"written_machine_s": machine_s(), "pid": os.getpid(), "state_directory": str(tree / "state"), **status}
    (DIRECTORIES[1] / file_name(tree / "state")).write_text(json.dumps(content))


def save_passed(tree, program):
    store = Store(tree / "state")
    store.save(UPDATE_FILE, passed_line(program).encode())
    store.close()


def test_environment_of_a_version_is_reused_after_a_roll_back(tree, run_update, monkeypatch):
    checked = []
    monkeypatch.setattr(environment, "check_free_space", lambda new, _wheels: checked.append(new.path))
    previous_umask = os.umask(0o077)
    code, output = run_update()
    assert os.umask(previous_umask) == 0o077
    forward = installed_name(tree)
    assert re.fullmatch(r"rambler-9\.9\.9-[0-9a-f]{8}", forward)
    path = tree / "opt" / forward
    assert path.stat().st_mode & 0o777 == 0o755  # the user of the service may read it
    assert (code, checked) == (0, [path])
    assert output.splitlines()[:5] == [
        "new.bundle: 9.9.9 (git abcd1234), hashes correct, signature not required",
        f"creating {path}: takes some minutes on a slow board",
        "tried",
        f"{tree}/bin/rambler points to {path}/bin/rambler, on trial for 3 starts",
        "no autopilot runs; the next start of the service uses it (sudo systemctl start rambler); waiting",
    ]
    assert "is on trial (0 starts so far)" in run_update()[1]
    assert run_update("--back")[0] == 0
    assert installed_name(tree) == "rambler"
    (tree / "bin/.rambler.trial").unlink()
    code, output = run_update()
    assert (code, "creating" in output, installed_name(tree)) == (0, False, forward)  # it is complete


def install_package(tree, name, group):
    """Put the metadata of an installed package with an entry point into the environment."""
    folder = tree / f"opt/rambler/lib/python3.11/site-packages/{name.replace('-', '_')}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(f"[{group}]\ncompass.acme = acme:DRIVER\n")


def test_update_without_an_installed_driver_package_is_refused(tree, run_update, tmp_path):
    install_package(tree, "some-program", "console_scripts")
    install_package(tree, "Rambler-Acme", "rambler.drivers")
    before = sorted(tree.rglob("*"))
    code, output = run_update()
    assert (code, installed_name(tree)) == (2, "rambler")
    assert output == (
        "rambler update: the bundle lacks the installed driver package Rambler-Acme 1.0; make bundle DRIVERS=WHEEL, "
        f"or remove the package from {tree / 'opt/rambler'}\n"
    )
    assert sorted(tree.rglob("*")) == before
    for number, other_wheel in enumerate(("rambler_acme2-1.0-py3-none-any.whl", "rambler_acme-1.0.tar.gz")):
        (folder := tmp_path / str(number)).mkdir()
        assert run_update(str(small_bundle(folder, wheels=[other_wheel])))[0] == 2
    (folder := tmp_path / "complete").mkdir()
    code, output = run_update(str(small_bundle(folder, wheels=["rambler_acme-2.0-py3-none-any.whl"])))
    assert code == 0
    assert "driver package Rambler-Acme 1.0: the bundle contains it" in output
    assert installed_name(tree).startswith("rambler-9.9.9-")


def test_roll_back_needs_a_previous_version_and_an_update_another_one(tree, run_update):
    assert run_update("--back") == (2, "rambler update: there is no previous version\n")
    (tree / "bin/.rambler.before").symlink_to(tree / "opt/rambler/bin/rambler")  # the present version
    assert run_update("--back") == (2, "rambler update: there is no previous version\n")
    run_update()
    (tree / "bin/.rambler.trial").unlink()
    assert run_update() == (2, "rambler update: 9.9.9 (git abcd1234) is already installed\n")


def test_armed_boat_with_state_from_drop_in_is_not_updated(tree, run_update):
    """The unit without its drop-in names a state directory without an autopilot."""
    write_status(tree, armed=True)
    unit = tree / "rambler.service"
    unit.write_text(unit.read_text().replace(str(tree / "state"), str(tree / "other")))
    (tree / "rambler.service.d").mkdir()
    command = f"{tree / 'bin/rambler'} run {tree / 'boat.toml'} --state {tree / 'state'} --wait"
    (tree / "rambler.service.d/override.conf").write_text(f"[Service]\nExecStart=\nExecStart={command}\n")
    code, output = run_update()
    assert (code, installed_name(tree)) == (2, "rambler")
    assert f"override.conf runs {tree / 'bin/rambler'} on {tree / 'state'}" in output


@pytest.mark.parametrize(
    ("program", "command", "is_ended"),
    [("bin/rambler", "run", True), ("bin/rambler", "walk", False), ("bin/other", "run", False)],
)
def test_only_the_autopilot_of_a_disarmed_boat_is_ended(tree, run_update, program, command, is_ended):
    arguments = [sys.executable, "-c", "input()", str(tree / program), command]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE) as process:
        write_status(tree, armed=False, pid=process.pid)
        code, output = run_update()
        assert (code, f"process {process.pid} ended" in output) == (0, is_ended)
        process.communicate(b"\n")
    assert process.returncode == (-signal.SIGTERM if is_ended else 0)


def test_armed_boat_is_updated_only_with_armed(tree, run_update):
    write_status(tree, armed=True)
    code, output = run_update()
    assert (code, installed_name(tree)) == (2, "rambler")
    assert "the boat is armed; disarm it, or use --armed" in output
    assert [path.name for path in (tree / "opt").iterdir()] == ["rambler"]  # refused before any work
    code, output = run_update(str(tree / "new.bundle"), "--armed")
    assert code == 0
    assert "no autopilot runs; the next start" in output  # the process in the status is not an autopilot of this link


@pytest.mark.parametrize("status", [{}, {"armed": False, "written_machine_s": 1.0}, {"armed": False, "pid": 2**22 + 1}])
def test_unknown_arming_state_counts_as_armed(tree, run_update, status):
    write_status(tree, **status)
    code, output = run_update()
    assert (code, installed_name(tree)) == (2, "rambler")
    assert "--armed" in output


@pytest.mark.parametrize("arguments", [(), ("--back",)])
def test_arming_during_the_checks_stops_the_update(tree, run_update, monkeypatch, arguments):
    if arguments:
        run_update()
    previous = installed_name(tree)

    def arm(*_):
        write_status(tree, armed=True)
        return iter(["tried"])

    monkeypatch.setattr(update, "self_check", arm)
    monkeypatch.setattr(update.os, "access", lambda *_: bool(arm()))
    code, output = run_update(*arguments)
    assert (code, installed_name(tree)) == (2, previous)
    assert "the boat is armed; disarm it" in output


def test_downgrade_needs_older(tree, run_update, tmp_path):
    older = small_bundle(tmp_path, version="0.0.1")
    code, output = run_update(str(older))
    assert (code, installed_name(tree)) == (2, "rambler")
    assert f"0.0.1 (git abcd1234) is older than the installed {__version__}" in output
    code, output = run_update(str(older), "--older")
    assert code == 0
    assert "is older than" in output


def test_same_version_is_compared_by_commit_time(tree, run_update, tmp_path, monkeypatch):
    monkeypatch.setattr(update, "ROOT", tmp_path)
    (tmp_path / "firmware_py").mkdir()
    (tmp_path / COMMIT_FILE).write_text("89abcdef\n1001\n")
    bundle = str(small_bundle(tmp_path, version=__version__))
    text = f"{__version__} (git abcd1234) is older than the installed {__version__} (git 89abcdef)"
    assert text in run_update(bundle)[1]
    assert installed_name(tree) == "rambler"
    code, output = run_update(bundle, "--older")
    assert (code, text in output) == (0, True)


@pytest.mark.parametrize("dangling", [False, True])
def test_signers_require_a_signature(tree, run_update, monkeypatch, dangling):
    if dangling:
        (tree / "signers").symlink_to(tree / "gone")
    else:
        (tree / "signers").write_text("")
    monkeypatch.setattr("firmware_py.cli.update.SIGNERS", tree / "signers")
    for arguments in ((), (str(tree / "new.bundle"), "--signers", str(tree / "signers"))):
        code, output = run_update(*arguments)
        assert (code, installed_name(tree), "not signed" in output) == (2, "rambler", True)


def test_one_update_at_a_time(tree, run_update):
    link = read_installation(tree / "rambler.service").link
    with update._lock_installation(link):
        assert run_update() == (2, "rambler update: another update is running; wait for its end\n")


def test_only_environments_of_updates_are_removed(tree, run_update):
    created, by_hand = "rambler-0.1.0.dev0-0123abcd", ("rambler-new", "rambler-hil", "rambler-2-of-mine")
    for name in (created, *by_hand):
        shutil.copytree(tree / "opt/rambler", tree / "opt" / name)
    code, output = run_update()
    assert code == 0
    assert f"removed {created} of an earlier update" in output
    assert {path.name for path in (tree / "opt").iterdir()} == {"rambler", *by_hand, installed_name(tree)}


def test_closed_terminal_does_not_interrupt_an_update(tree, monkeypatch):
    """The running program is ended although output fails after the switch."""
    signals = []
    monkeypatch.setattr(update, "_is_autopilot", lambda *_: True)
    monkeypatch.setattr(os, "kill", lambda pid, number: signals.append(number))
    write_status(tree, armed=False)

    def fail_after_switch(*_words, **_more):
        if installed_name(tree) != "rambler":
            raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("builtins.print", fail_after_switch)
    arguments = ["update", str(tree / "new.bundle"), "--unit", str(tree / "rambler.service")]
    assert main(arguments) == 0
    assert signal.SIGTERM in signals


def test_failed_check_leaves_no_files(tree, run_update, monkeypatch):
    def fails(_candidate):
        yield "tried"
        raise UpdateError("it does not start: no")

    monkeypatch.setattr(update, "self_check", fails)
    assert run_update() == (2, "rambler update: it does not start: no\n")
    assert [path.name for path in (tree / "opt").iterdir()] == ["rambler"]
    assert [path.name for path in (tree / "bin").iterdir()] == ["rambler"]


def test_invalid_or_missing_bundle_is_refused(tree, run_update):
    (tree / "text").write_text("hello")
    assert "not a bundle" in run_update(str(tree / "text"))[1]
    os.mkfifo(tree / "pipe")
    for path, text in ((tree / "pipe", "is a pipe"), (Path("/dev/zero"), "is a device"), (tree, "Is a directory")):
        code, output = run_update(str(path))
        assert (code, output.startswith(f"rambler update: {path}: {text}")) == (2, True), output
    assert run_update(str(tree / "nothing"))[0] == 2


def edit(path, old, new):
    path.write_text(path.read_text().replace(old, new))


def replace_link(tree):
    (tree / "bin/rambler").unlink()
    shutil.copy(tree / "opt/rambler/bin/rambler", tree / "bin/rambler")


UNIT, CONFIG = "rambler.service", "opt/rambler/pyvenv.cfg"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda tree: edit(tree / UNIT, "ExecStartPre", "#"), "is not a current unit"),
        (lambda tree: edit(tree / UNIT, " run ", " walk "), "is not a current unit"),
        (lambda tree: edit(tree / UNIT, "ExecStart=", 'ExecStart="'), "is not a current unit"),
        (lambda tree: (tree / UNIT).unlink(), "only a service can be updated"),
        (replace_link, "is not a link"),
        (lambda tree: (tree / CONFIG).write_text("include-system-site-packages = true\n"), "A board without wheels"),
        (lambda tree: (tree / CONFIG).unlink(), "is not in a virtual environment"),
        (lambda tree: (tree / CONFIG).write_text("\n" * ((1 << 16) + 1)), "is not in a virtual environment"),
    ],
    ids=[
        "no trial",
        "other command",
        "open quote",
        "no unit",
        "no link",
        "system packages",
        "no config",
        "large config",
    ],
)
def test_unsuitable_installation_is_refused(tree, run_update, change, text):
    change(tree)
    code, output = run_update()
    assert (code, text in output) == (2, True), output


def test_end_of_a_trial_is_reported(tree, run_update):
    installation, output = read_installation(tree / "rambler.service"), []
    run_update()
    program = installation.link.target()
    save_passed(tree, program)
    assert update.await_trial(installation, output.append)
    assert installation.link.trial() is None
    for slot in (tree / "state").glob(f"{UPDATE_FILE}.*"):
        slot.unlink()
    assert update.await_trial(installation, output.append)
    run_update("--back")
    (tree / "bin/.rambler.before").replace(tree / "bin/rambler")
    (tree / "bin/.rambler.trial").replace(tree / "bin/.rambler.failed")
    assert not update.await_trial(installation, output.append)
    assert output[:2] == ["trial passed: the new version stays", "trial passed before: the version stays"]
    assert output[2].startswith("rolled back: rambler has not passed its trial in 0 starts")


def test_trial_is_awaited_for_three_starts(tree, run_update, monkeypatch):
    """Each start may take 90 s, and passes after 120 s."""
    run_update()
    clock_s, output = [0.0], []

    def sleep(seconds):
        clock_s[0] += seconds
        if clock_s[0] == 300.0:
            with (tree / "bin/.rambler.trial").open("a") as file:
                file.write("start\n")

    monkeypatch.setattr(update, "time", SimpleNamespace(monotonic=lambda: clock_s[0], sleep=sleep))
    assert not update.await_trial(read_installation(tree / "rambler.service"), output.append)
    assert clock_s == [630.0]
    assert output == [
        "start 1 of 3; passes after 120 s", "trial not finished; the next starts decide, see rambler status"
    ]  # fmt: skip


def test_record_of_a_trial_is_read_up_to_its_size_limit(tree):
    program = tree / "opt/rambler/bin/rambler"
    slot, line = tree / "state/update.state.0", passed_line(program).encode()
    for size, has_passed in (((1 << 18) + 1, False), (1 << 18, True)):
        slot.write_bytes(line.rjust(size, b"\n"))
        assert update._has_passed(tree / "state", program) is has_passed
    slot.rename(tree / "state/other")
    slot.symlink_to(tree / "state/other")
    assert not update._has_passed(tree / "state", program)


def test_trial_passed_unobserved_allows_the_next_update(tree, run_update, tmp_path):
    """The next start of the service removes such a trial, which may be months later."""
    run_update()
    save_passed(tree, read_installation(tree / "rambler.service").link.target())
    code, output = run_update(str(small_bundle(tmp_path, version="9.9.10")))
    assert (code, installed_name(tree).startswith("rambler-9.9.10-")) == (0, True), output


def test_version_that_has_passed_needs_no_trial(tree, run_update):
    old = read_installation(tree / "rambler.service").link.target()
    save_passed(tree, old)
    assert "on trial for 3 starts" in run_update()[1]
    code, output = run_update("--back")
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
    dry = tomllib.loads(vehicle_text_without_ports(tmp_path / "boat.toml", work))
    assert "link" not in dry
    assert dry["compass"]["port"] == dry["position"]["port"] == str(work / "port0")
    assert dry["rudder"]["port"] == str(work / "port1")
    assert dry["parameters"] == {"file": str(tmp_path / "more.param"), "CTL_K1": 30.5}
    (tmp_path / "boat.toml").write_text(VEHICLE.replace('file = "more.param"', ""))
    assert tomllib.loads(vehicle_text_without_ports(tmp_path / "boat.toml", work))["parameters"] == {"CTL_K1": 30.5}
    (tmp_path / "boat.toml").write_text("#" * ((1 << 20) + 1))
    with pytest.raises(UpdateError, match="is larger than 1 MiB"):
        vehicle_text_without_ports(tmp_path / "boat.toml", work)
    (tmp_path / "boat.toml").write_text("[")
    with pytest.raises(UpdateError, match=r"boat\.toml"):
        vehicle_text_without_ports(tmp_path / "boat.toml", work)


def test_checks_use_a_copy_of_the_state(tmp_path, monkeypatch):
    for name in ("state", "work", "state/logs"):
        (tmp_path / name).mkdir()
    for name in ("parameters.param.0", "signing.key.1", "lock", "logs/00000001.BIN"):
        (tmp_path / "state" / name).write_text(name)
    (tmp_path / "boat.toml").write_text(VEHICLE)
    paths = (tmp_path / "boat.toml", tmp_path / "state", tmp_path / "work")
    candidate = Candidate(Environment(tmp_path / "new"), None, *paths)
    for name in CHECKS:
        monkeypatch.setitem(CHECKS, name, lambda _candidate: "good")
    assert list(self_check(candidate)) == [f"{name}: good" for name in CHECKS]
    copies = {path.name: path for path in candidate.copy.iterdir()}
    assert set(copies) == {"parameters.param.0", "signing.key.1"}
    assert [path.stat().st_mode & 0o777 for path in (candidate.copy, copies["signing.key.1"])] == [0o700, 0o600]
    shutil.rmtree(candidate.copy)
    os.truncate(tmp_path / "state/parameters.param.0", (4 << 20) + 1)
    with pytest.raises(UpdateError, match="cannot be copied: is larger than 4 MiB"):
        list(self_check(candidate))
    shutil.rmtree(candidate.copy)
    (tmp_path / "state/parameters.param.0").unlink()
    (tmp_path / "state/parameters.param.0").symlink_to(tmp_path / "state/signing.key.1")
    with pytest.raises(UpdateError, match="cannot be copied: is a symbolic link"):
        list(self_check(candidate))


@pytest.mark.parametrize(
    ("output", "text"),
    [
        (
            "9 ticks, 4 recomputed\n1 damaged ticks, 3 unreadable bytes\nNOT identical\n",
            "00000001.BIN is incomplete: 9 ticks, 4 recomputed; 1 damaged ticks, 3 unreadable bytes",
        ),
        (
            "9 ticks, 9 recomputed\n3 commands differ, the first at\nNOT identical\n",
            "the new version steers differently: 00000001.BIN, 3 commands differ, the first at",
        ),
        ("", None),  # a failure
    ],
)
def test_damaged_or_different_log_does_not_prevent_an_update(tmp_path, monkeypatch, output, text):
    (tmp_path / "state/logs").mkdir(parents=True)
    (tmp_path / "state/logs/00000001.BIN").touch()
    result = subprocess.CompletedProcess([], 1, output, "Traceback" if text is None else "")
    monkeypatch.setattr("firmware_py.install.self_check._run", lambda *_: result)
    candidate = Candidate(Environment(tmp_path), None, tmp_path / "boat.toml", tmp_path / "state", tmp_path)
    if text is None:
        with pytest.raises(UpdateError, match="cannot replay"):
            CHECKS["newest log"](candidate)
    else:
        assert CHECKS["newest log"](candidate) == text


def test_changed_unit_is_reported(tree, run_update, monkeypatch):
    installed = read_installation(tree / "rambler.service").unit
    monkeypatch.setattr(update, "read_printed_unit", lambda _program, _words: installed)
    assert "another service unit" not in run_update()[1]
    (tree / "bin/.rambler.trial").unlink()
    calls = []

    def print_unit(program, arguments):
        calls.append((program.parents[1].name, arguments))
        return installed.replace("WatchdogSec=5", "WatchdogSec=4")

    monkeypatch.setattr(update, "read_printed_unit", print_unit)
    arguments = [str(tree / "boat.toml"), "--state", str(tree / "state")]
    assert f"after the trial: sudo rambler service install {' '.join(arguments)}" in run_update("--back")[1]
    assert calls == [("rambler", [*arguments, "--program", str(tree / "bin/rambler")])]
    (tree / "bin/.rambler.trial").unlink()
    assert "another service unit" in run_update()[1]


def test_unit_of_a_version_is_its_output(tmp_path):
    program = tmp_path / "rambler"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m firmware_py "$@"\n')
    program.chmod(0o755)
    service = Service(("/opt/rambler",), Path("/etc/boat.toml"), Path("/srv/state"), Path("/dev/watchdog"))
    arguments = ["/etc/boat.toml", "--state", "/srv/state", "--watchdog", "/dev/watchdog", "--program", "/opt/rambler"]
    assert read_printed_unit(program, arguments) == build_unit(service)
    for script in ("echo no", f"echo '# {UNIT_PATH}'; echo; echo '# /'; exit 3"):
        program.write_text(f"#!/bin/sh\n{script}\n")
        assert read_printed_unit(program, arguments) is None
    assert read_printed_unit(tmp_path / "gone", arguments) is None
