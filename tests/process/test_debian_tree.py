"""In a fresh Debian tree the handbook's own steps reach a service that systemd starts, watches and starts again.

`.ci/debian_tree` makes the tree; where none can be booted the test says why and is skipped.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import textwrap
import threading
import time
import urllib.request
from pathlib import Path

import pytest

from support.asking_station import AskingStation
from support.debian_tree import BootedTree, why_not
from support.paths import ROOT
from support.program import unused_ports

DIALOUT = 20  # the number of the group, in Debian
HEARTBEAT, CURRENT = 0, 42
ARM, SET_MODE, SET_CURRENT = 400, 176, 224
AUTO, ARMED = 10, 128
SETTINGS = {"BOOT_RESUME": 2, "CLK_SET": 0}
PATIENCE_S = 60.0
PORTS_OF_THE_BOX = "[Service]\nDeviceAllow=char-pts rw\n"

WHY_NOT = why_not()
pytestmark = [pytest.mark.proof, pytest.mark.timeout(1800), pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "-")]


def steps():
    """The blocks of the handbook that are its script, in their order."""
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
    """A boat whose ports are to be seen in the tree."""
    made = make_boat(speed=None, settings=SETTINGS, without=("link",))
    ended = threading.Event()

    def live():
        while not ended.is_set():
            made.time.step(made.board, made.now_s + 0.05)

    made.time.begin(made.board, None)
    text = (made.directory / "boat.toml").read_text()
    for name, path in made.board.paths().items():
        os.chown(Path(path).resolve(), -1, DIALOUT)
        Path(path).resolve().chmod(0o660)
        (tree.shared / name).symlink_to(Path(path).resolve())
        text = text.replace(path, f"/srv/boat/{name}")
    station = AskingStation()
    text += f'[link]\nurls = ["udpin:127.0.0.1:{station.connect()}"]\n'
    (tree.shared / "boat.toml").write_text(text)
    thread = threading.Thread(target=live)
    thread.start()
    with station.socket:
        yield station
    ended.set()
    thread.join()


def until(found, what):
    give_up_s = time.monotonic() + PATIENCE_S
    while not (value := found()):
        assert time.monotonic() < give_up_s, f"no {what}"
        time.sleep(0.1)
    return value


def pid_of(tree):
    return int(tree.run("systemctl show rambler --property MainPID --value") or "0")


def restarted(tree, before, command):
    """Run what disturbs the service, and wait until another process answers."""
    tree.run(command)
    return until(lambda: (pid := pid_of(tree)) not in (0, before) and pid, "new process")


def installed(tree):
    """Follow the handbook, and return what the service says of itself then."""
    install, example, service = steps()
    tree.run(f"cd /srv/boat\n{install}")
    tree.run(example)
    assert "[compass]" in tree.run("cat /etc/rambler/boat.toml")
    tree.run("cp /srv/boat/boat.toml /etc/rambler/boat.toml")  # a reader of the manual writes it by hand
    (tree.shared / "box.conf").write_text(PORTS_OF_THE_BOX)
    tree.run("install -D --mode=644 /srv/boat/box.conf /etc/systemd/system/rambler.service.d/box.conf")
    return tree.run(service)


def test_the_steps_of_the_manual_give_a_service_that_restarts(tree, boat):
    print(installed(tree))
    assert tree.run("systemctl is-enabled rambler").strip() == "enabled"
    assert boat.request(HEARTBEAT).autopilot is not None
    print(tree.run("systemd-analyze security --no-pager rambler | tail -1"))
    assert tree.run("systemd-analyze verify /etc/systemd/system/rambler.service 2>&1") == ""
    assert "not allowed" not in tree.run("journalctl --no-pager -u rambler"), "priority, memory or clock are refused"

    first = pid_of(tree)
    second = restarted(tree, first, f"kill -KILL {first}")
    assert boat.request(HEARTBEAT)
    third = restarted(tree, second, f"kill -STOP {second}")
    assert boat.request(HEARTBEAT)
    journal = tree.run("journalctl --no-pager -u rambler")
    assert "Started again: killed, SIGKILL (the first time)" in journal
    assert "Started again: watchdog" in journal
    fourth = restarted(tree, third, "systemctl restart rambler")
    tree.cut_power()
    tree.boot()
    assert boat.request(HEARTBEAT)
    assert pid_of(tree) != fourth
    assert "Started again: cut off" in tree.run("journalctl --no-pager --boot -u rambler")
    print(tree.run("rambler service remove"))
    assert pid_of(tree) == 0


def page_at(address):
    try:
        with urllib.request.urlopen(address, timeout=5.0) as answer:
            return answer.read()
    except OSError:
        return b""


def test_an_update_reports_a_changed_unit_and_its_command_installs_it(tree, boat):
    """The installed unit of another version stays until the operator runs the reported command."""
    installed(tree)
    before = pid_of(tree)
    unit = "/etc/systemd/system/rambler.service"
    tree.run(f"sed -i s/^WatchdogSec=5$/WatchdogSec=7/ {unit}; systemctl daemon-reload")
    restarted(tree, before, "systemctl restart rambler")
    python = tree.run("python3 -c 'import sys; print(*sys.version_info[:2], sep=chr(46))'").strip()
    words = [ROOT / ".ci/bundle.py", "--for", f"{platform.machine()}:{python}", "--out", tree.shared]
    subprocess.run([sys.executable, *map(str, words)], check=True)
    output = tree.run("rambler update /srv/boat/*.bundle")
    print(output)
    again = re.search("its unit is another one than that which is installed: when it has passed, sudo (.*)", output)[1]
    assert boat.request(HEARTBEAT)
    assert tree.run("systemctl show rambler --property WatchdogUSec --value").strip() == "7s"
    (port,) = unused_ports(["tcp"])
    print(tree.run(f"{again} --view 127.0.0.1:{port}"))
    restarted(tree, pid_of(tree), "systemctl restart rambler; systemctl start rambler-view")
    assert boat.request(HEARTBEAT)
    assert tree.run("systemctl show rambler --property WatchdogUSec --value").strip() == "5s"
    assert tree.run("systemctl is-enabled rambler rambler-view").split() == ["enabled", "enabled"]
    assert b"<html" in until(lambda: page_at(f"http://127.0.0.1:{port}/"), "page").lower()
    print(tree.run("systemd-analyze security --no-pager rambler-view | tail -1"))
    tree.run("rambler service remove")
    assert pid_of(tree) == 0
    assert page_at(f"http://127.0.0.1:{port}/") == b""
