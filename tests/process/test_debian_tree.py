"""In a new Debian tree the steps of the manual install a service that systemd starts, monitors and restarts.

`.ci/debian_tree` makes the tree. If none can be booted, the test is skipped with the reason.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import textwrap
import urllib.request
from pathlib import Path

import pytest

from support.debian_tree import BootedTree, reason_to_skip
from support.paths import ROOT
from support.processes import running_devices, wait_until
from support.program import unused_ports
from support.retrying_station import RetryingStation

DIALOUT = 20  # group id in Debian
HEARTBEAT = 0  # message number
SETTINGS = {"BOOT_RESUME": 2, "CLK_SET": 0}
DROP_IN = "[Service]\nDeviceAllow=char-pts rw\n"

REASON = reason_to_skip()
pytestmark = [pytest.mark.proof, pytest.mark.timeout(1800), pytest.mark.skipif(bool(REASON), reason=REASON or "-")]


def script_blocks():
    """Return the shell blocks of the installation page in order."""
    page = (ROOT / "docs/how-to/installation.md").read_text()
    return [textwrap.dedent(block) for block in re.findall(r"^ *```sh\n(.*?)^ *```$", page, re.MULTILINE | re.DOTALL)]


@pytest.fixture
def tree(tmp_path):
    (shared := tmp_path / "srv").mkdir()
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(shared), str(ROOT)]
    subprocess.run(wheel, check=True)
    shutil.copy(ROOT / ".ci/requirements-onboard.txt", shared)
    (layer := tmp_path / "layer").mkdir()
    tmp_path.chmod(0o755)
    shared.chmod(0o755)
    with BootedTree(layer, shared) as booted:
        yield booted


@pytest.fixture
def boat(make_boat, tree, tmp_path):
    """The ground station of a boat whose ports are visible in the tree."""
    boat = make_boat(speed=None, settings=SETTINGS, without=("link",))
    station = RetryingStation()
    port = station.connect()
    with running_devices(boat), station.socket:
        text = (boat.directory / "boat.toml").read_text()
        for name, path in boat.board.paths().items():
            os.chown(Path(path).resolve(), -1, DIALOUT)
            Path(path).resolve().chmod(0o660)
            (tree.shared / name).symlink_to(Path(path).resolve())
            text = text.replace(path, f"/srv/boat/{name}")
        text += f'[link]\nurls = ["udpin:127.0.0.1:{port}"]\n'
        (tree.shared / "boat.toml").write_text(text)
        yield station


def pid_of(tree):
    return int(tree.run("systemctl show rambler --property MainPID --value") or "0")


def wait_for_restart(tree, previous_pid, command):
    """Run a command that restarts the service; return the new process id."""
    tree.run(command)
    return wait_until(lambda: (pid := pid_of(tree)) not in (0, previous_pid) and pid, "new process")


def follow_manual(tree):
    """Follow the installation page; return the output of its last step."""
    install, example, service = script_blocks()
    tree.run(f"cd /srv/boat\n{install}")
    tree.run(example)
    assert "[compass]" in tree.run("cat /etc/rambler/boat.toml")
    tree.run("cp /srv/boat/boat.toml /etc/rambler/boat.toml")  # as the operator edits it
    (tree.shared / "box.conf").write_text(DROP_IN)
    tree.run("install -D --mode=644 /srv/boat/box.conf /etc/systemd/system/rambler.service.d/box.conf")
    return tree.run(service)


def test_steps_of_the_manual_install_a_service_that_restarts(tree, boat):
    print(follow_manual(tree))
    assert tree.run("systemctl is-enabled rambler").strip() == "enabled"
    assert boat.request(HEARTBEAT).autopilot is not None
    print(tree.run("systemd-analyze security --no-pager rambler | tail -1"))
    assert tree.run("systemd-analyze verify /etc/systemd/system/rambler.service 2>&1") == ""
    assert "not allowed" not in tree.run("journalctl --no-pager -u rambler"), (
        "priority, memory lock or clock not allowed"
    )

    first_pid = pid_of(tree)
    second_pid = wait_for_restart(tree, first_pid, f"kill -KILL {first_pid}")
    assert boat.request(HEARTBEAT)
    third_pid = wait_for_restart(tree, second_pid, f"kill -STOP {second_pid}")
    assert boat.request(HEARTBEAT)
    journal = tree.run("journalctl --no-pager -u rambler")
    assert "Started again: killed, SIGKILL (the first time)" in journal
    assert "Started again: watchdog" in journal
    fourth_pid = wait_for_restart(tree, third_pid, "systemctl restart rambler")
    tree.cut_power()
    tree.boot()
    assert boat.request(HEARTBEAT)
    assert pid_of(tree) != fourth_pid
    assert "Started again: cut off" in tree.run("journalctl --no-pager --boot -u rambler")
    print(tree.run("rambler service remove"))
    assert pid_of(tree) == 0


def fetch_page(address):
    try:
        with urllib.request.urlopen(address, timeout=5.0) as response:
            return response.read()
    except OSError:
        return b""


def test_update_reports_a_changed_unit_and_its_command_installs_it(tree, boat):
    """The installed unit of another version stays until the operator runs the reported command."""
    follow_manual(tree)
    previous_pid = pid_of(tree)
    unit = "/etc/systemd/system/rambler.service"
    tree.run(f"sed -i s/^WatchdogSec=5$/WatchdogSec=7/ {unit}; systemctl daemon-reload")
    wait_for_restart(tree, previous_pid, "systemctl restart rambler")
    python = tree.run("python3 -c 'import sys; print(*sys.version_info[:2], sep=chr(46))'").strip()
    words = [ROOT / ".ci/bundle.py", "--for", f"{platform.machine()}:{python}", "--out", tree.shared]
    subprocess.run([sys.executable, *map(str, words)], check=True)
    output = tree.run("rambler update /srv/boat/*.bundle")
    print(output)
    install_command = re.search(
        "its unit is another one than that which is installed: when it has passed, sudo (.*)", output
    )[1]
    assert boat.request(HEARTBEAT)
    assert tree.run("systemctl show rambler --property WatchdogUSec --value").strip() == "7s"
    (port,) = unused_ports(["tcp"])
    print(tree.run(f"{install_command} --view 127.0.0.1:{port}"))
    wait_for_restart(tree, pid_of(tree), "systemctl restart rambler; systemctl start rambler-view")
    assert boat.request(HEARTBEAT)
    assert tree.run("systemctl show rambler --property WatchdogUSec --value").strip() == "5s"
    assert tree.run("systemctl is-enabled rambler rambler-view").split() == ["enabled", "enabled"]
    assert b"<html" in wait_until(lambda: fetch_page(f"http://127.0.0.1:{port}/"), "page").lower()
    print(tree.run("systemd-analyze security --no-pager rambler-view | tail -1"))
    tree.run("rambler service remove")
    assert pid_of(tree) == 0
    assert fetch_page(f"http://127.0.0.1:{port}/") == b""
