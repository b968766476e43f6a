"""The autopilot with a disk that cannot be written, or with too little memory, descriptors or threads."""

import contextlib
import json
import os
import pty
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.log.reader import LogReader
from firmware_py.plans.items import Command
from firmware_py.system.slots import read_content
from firmware_py.system.store import Store
from support.paths import ROOT
from support.program import Program

VEHICLE = """
[compass]
driver = "nmea"
port = "{}"
baud = 4800
[rudder]
driver = "volz"
port = "{}"
baud = 115200
"""
UNPRIVILEGED_USER = 65534
# Root may write anywhere, so the program changes its user after the imports: others may not read the Python of root.
AS_UNPRIVILEGED_USER = f"""
import gettext, locale, os, resource, shutil, subprocess, sys, traceback
import firmware_py.cli.run
from firmware_py.__main__ import main
if not os.geteuid():
    os.setgroups([]), os.setgid({UNPRIVILEGED_USER}), os.setuid({UNPRIVILEGED_USER})
sys.exit(main(sys.argv[1:]))
"""
NORMAL_PROGRAM = ["-m", "firmware_py"]
# As root the tests start programs as another user, who must be able to read the checkout.
needs_readable_checkout = pytest.mark.skipif(
    os.geteuid() == 0 and not all(path.stat().st_mode & 0o001 for path in (ROOT, *ROOT.parents)),
    reason="other users cannot read this checkout",
)
MISSION = plan_to_text(Plan.of(PlanKind.MISSION, (PlanItem(Command.WAYPOINT, 3, x=1, y=2),))).encode()


@pytest.fixture
def directory():
    """A directory that all users may enter."""
    directory = Path(tempfile.mkdtemp())
    directory.chmod(0o755)
    yield directory
    shutil.rmtree(directory)


@pytest.fixture
def vehicle(directory):
    """A vehicle file with existing ports."""
    ends = [pty.openpty() for _ in range(2)]
    ports = [os.ttyname(slave) for _, slave in ends]
    for port in ports:
        Path(port).chmod(0o666)
    path = directory / "boat.toml"
    path.write_text(VEHICLE.format(*ports))
    yield path
    for descriptor in (end for pair in ends for end in pair):
        os.close(descriptor)


@contextlib.contextmanager
def running(vehicle, tmp_path, *options, program_words=NORMAL_PROGRAM):
    program = Program("rambler", [sys.executable, *program_words, "run", str(vehicle), *map(str, options)], tmp_path)
    try:
        yield program
        program.send_signal(signal.SIGTERM)
        assert program.exit_code() == 0
    finally:
        program.close()


def refused(vehicle, *options, program_words=NORMAL_PROGRAM, limit=None):
    """Return the one-line error of a run that ends at once."""
    process = subprocess.run(
        [sys.executable, *program_words, "run", str(vehicle), *map(str, options)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60.0,
        preexec_fn=limit,
        check=False,
    )
    (line,) = process.stderr.splitlines()
    assert (process.returncode, process.stdout) == (2, "")
    return line


def fill_state(directory):
    """Store a parameter and a mission, as an earlier run."""
    store = Store(directory)
    store.save("parameters.param", b"CTL_K1 33\n")
    store.save("mission.plan", MISSION)
    store.close()
    for path in directory.iterdir():
        path.chmod(0o644)
    directory.chmod(0o755)


def parameters_in_log(directory):
    (log,) = (directory / "logs").glob("*.BIN")
    first_tick = next(iter(LogReader(log)))
    return first_tick.checkpoint


@needs_readable_checkout
def test_autopilot_starts_without_a_writable_state_directory(directory, vehicle, tmp_path, capsys):
    state = directory / "state"
    fill_state(state)
    program_words = ["-c", AS_UNPRIVILEGED_USER]
    line = refused(vehicle, "--state", state, program_words=program_words)
    assert line == f"rambler run: state directory {state}: Permission denied; choose another with --state"
    with running(vehicle, tmp_path, "--state", state, "--wait", program_words=program_words) as program:
        program.expect(f"state directory {state}: Permission denied")
        program.expect("Loaded from storage: 1 parameters, mission of 1 items, fence of 0 items")
        program.expect("Storage error: logs or settings not saved")
        assert not (state / "logs").exists()

        # If the state directory belongs to another user, the status could be written by any user and is ignored.
        main(["status", "--state", str(state), "--json"])
        status = json.loads(capsys.readouterr().out)
        assert (status["status"] == "running") == (os.geteuid() != 0)
        for path in (state, *state.iterdir()):
            path.chmod(0o777)
        program.expect("Storage error cleared")
    assert b"CTL_K1 33\nSTAT_BOOTCNT 1\n" in read_content(state, "parameters.param")
    assert '"CTL_K1":33.0' in parameters_in_log(state)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may write files of other users")
def test_root_does_not_write_the_state_of_another_user(directory, vehicle):
    """The service could not read files that root has written."""
    state = directory / "state"
    fill_state(state)
    os.chown(state, UNPRIVILEGED_USER, UNPRIVILEGED_USER)
    previous = sorted(state.iterdir())
    line = refused(vehicle, "--state", state)
    assert line.startswith(f"rambler run: state directory {state} belongs to user ")
    assert "run this as that user" in line
    assert sorted(state.iterdir()) == previous


@needs_readable_checkout
def test_unreadable_state_is_reported_and_the_vehicle_file_applies(directory, vehicle, tmp_path):
    state = directory / "state"
    fill_state(state)
    state.chmod(0o700)
    with running(vehicle, tmp_path, "--state", state, "--wait", program_words=["-c", AS_UNPRIVILEGED_USER]) as program:
        if os.geteuid():
            return  # the directory belongs to this user
        program.expect(r"parameters.param.0 cannot be read \(Permission denied\)")
        program.expect("Loaded from storage: 0 parameters, mission of 0 items")
        program.expect("Storage error: logs")


def test_state_directory_that_appears_late_is_used_with_its_content(directory, vehicle, tmp_path):
    fill_state(directory / "medium")
    (directory / "mount").touch()  # a file as parent directory, which is an error for root, too
    line = refused(vehicle, "--state", directory / "mount" / "state")
    assert "Not a directory; choose another with --state" in line
    with running(vehicle, tmp_path, "--state", directory / "mount" / "state", "--wait") as program:
        program.expect("Loaded from storage: 0 parameters")
        program.expect("Storage error: logs")
        (directory / "mount").unlink()
        (directory / "mount").mkdir()
        (directory / "medium").rename(directory / "mount" / "state")
        program.expect("State directory mounted: its content is used from the next start")
        program.expect("Storage error cleared")
    assert b"CTL_K1 33\nSTAT_BOOTCNT 1\n" in read_content(directory / "mount" / "state", "parameters.param")
    assert read_content(directory / "mount" / "state", "mission.plan") == MISSION


@pytest.mark.parametrize("umask", [pytest.param(0o000, marks=pytest.mark.proof), 0o077])
def test_files_have_modes_for_owner_and_group_with_any_umask(umask, directory, vehicle, tmp_path):
    state = directory / "new" / "state"
    previous = os.umask(umask)
    try:
        with running(vehicle, tmp_path, "--state", state) as program:
            program.wait_for(lambda: list(state.glob("logs/thin/*.BIN")), "no log")
    finally:
        os.umask(previous)
    paths = (state.parent, state, *state.rglob("*"))
    modes = {str(path.relative_to(directory)): stat.S_IMODE(path.stat().st_mode) for path in paths}
    assert modes == {
        "new": 0o750,
        "new/state": 0o750,
        "new/state/lock": 0o640,
        "new/state/endings.record.0": 0o640,
        "new/state/endings.record.1": 0o640,
        "new/state/parameters.param.0": 0o640,
        "new/state/logs": 0o750,
        "new/state/logs/00000001.BIN": 0o640,
        "new/state/logs/thin": 0o750,
        "new/state/logs/thin/00000001.BIN": 0o640,
    }


def limit_resource(kind, value):
    return lambda: resource.setrlimit(kind, (value, value))


@pytest.mark.parametrize("count", [9, pytest.param(14, marks=pytest.mark.proof)])
def test_too_few_descriptors_are_a_one_line_error(count, directory, vehicle):
    line = refused(vehicle, "--state", directory / "state", limit=limit_resource(resource.RLIMIT_NOFILE, count))
    assert "oo many open files" in line


@pytest.mark.parametrize("megabytes", [48, 76, 100])
def test_too_little_memory_is_a_one_line_error(directory, vehicle, megabytes):
    """From 62 to 94 MB the limit is reached by the library of numpy, which would end the process itself."""
    line = refused(vehicle, "--state", directory / "state", limit=limit_resource(resource.RLIMIT_AS, megabytes << 20))
    assert "out of memory" in line


@needs_readable_checkout
def test_missing_thread_is_a_one_line_error(directory, vehicle):
    directory.chmod(0o777)
    one_thread = "resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))\nsys.exit"
    line = refused(
        vehicle,
        "--state",
        directory / "state",
        program_words=["-c", AS_UNPRIVILEGED_USER.replace("sys.exit", one_thread)],
    )
    assert "cannot start a thread" in line


@needs_readable_checkout
def test_22_descriptors_are_sufficient_and_too_few_for_many_links(directory, vehicle, tmp_path):
    links = [word for port in range(20) for word in ("--link", f"udpout:127.0.0.1:{40000 + port}")]
    limit = limit_resource(resource.RLIMIT_NOFILE, 22)
    assert "oo many open files" in refused(vehicle, "--state", directory / "state", *links, limit=limit)
    program_words = [
        "-c",
        "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (22, 22))\n" + AS_UNPRIVILEGED_USER,
    ]
    directory.chmod(0o777)
    with running(
        vehicle, tmp_path, "--state", directory / "state" / "another", "--wait", program_words=program_words
    ) as program:
        program.expect("Mode HOLD")
