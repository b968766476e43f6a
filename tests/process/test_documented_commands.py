"""Each command block of the manual runs, or a comment above it gives the reason why it is not run.

The comment is `<!-- not run: REASON -->`. The blocks of a page run in a directory with the files that they assume: a
vehicle file, logs, recordings, a state directory. Runs are shortened, and programs without an end are interrupted.
"""

import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.common.plan import PlanKind
from firmware_py.sensors import mti_protocol
from support.paths import REPLAY, ROOT
from support.plans import item, save_plans

BLOCK = re.compile(r"(?:^ *<!-- not run: ([^\n]+) -->\n\s*)?^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(
    r"^ *(?:\$ |sudo |-u \w+ )*(rambler|rambler-hil|make|python\S*|pip|pytest|openssl|apt-get|ssh\S*|scp|dask)\s"
)
HELP = re.compile(r"<!-- (help|output): .*?<!-- end -->", re.DOTALL)
# Options that are appended, and so override: short runs.
SHORT = {
    "rambler-hil run": "--speed max --seconds 15 --out short-{number}",
    "rambler listen": "--seconds 0.2",
    "rambler-hil compare": "--seeds 1 --only paper -- calm",
    "rambler-hil tune": "--evaluations 20 --scenarios calm",
}
UNTIL_ENDED = ("rambler run", "rambler view", "rambler-hil sbd-gateway", "rambler-hil serve-json")
# Exit code 1, a finding, is no failure: the devices are missing, or the logs are too short.
FINDING = ("rambler listen", "rambler check", "rambler calibrate", "rambler energy", "rambler status")
QUICK = ("make", "rambler example", "rambler plan", "rambler key", "rambler listen", "rambler calibrate")
PLACES = {
    "/etc/rambler/": "etc/",
    "/var/lib/rambler": "DIR",
    "~/": "home/",
    "0.0.0.0": "127.0.0.1",
    " [--json]": "",
    "runs/before runs/after": "runs/twin runs/twin",
}
LIVES_S, PATIENCE_S = 4.0, 300.0
PASSPHRASE = "a passphrase\n"


def blocks():
    """Yield page and line, the reason if it is not run, and the commands of each block of commands."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        if "_build" in page.parts:
            continue
        text = HELP.sub(lambda found: "\n" * found[0].count("\n"), page.read_text())
        for found in BLOCK.finditer(text):
            lines = found[3].replace("\\\n", " ").splitlines() if found[2] in ("", "sh", "text") else []
            prompted = [line.strip()[2:] for line in lines if line.strip().startswith("$ ")]
            commands = prompted or [line.strip() for line in lines]
            if commands and PROGRAM.match(commands[0]):
                name = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, found.start(3))}"
                yield name, found[1], [re.sub(r"\s+# .*", "", command) for command in commands]


def is_quick(commands):
    return all(re.sub(r"^sudo ", "", command).startswith(QUICK) for command in commands)


def pages():
    """Yield the blocks of each page that are run: the quick ones, and the others marked as proof."""
    found = {}
    for name, reason, commands in blocks():
        if reason is None:
            found.setdefault((name.partition(":")[0], is_quick(commands)), []).append((name, commands))
    for (page, quick), some in found.items():
        yield pytest.param(some, id=f"{page}-{'quick' if quick else 'long'}", marks=[] if quick else pytest.mark.proof)


@pytest.fixture
def place(tmp_path):
    """Return a directory with the files that the pages assume."""
    for name in ("etc", "home/post", "STATE/logs", "DIR/logs", "state/logs", "bin", "runs/tank-1/state/logs", "params"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("boat.toml", "etc/boat.toml"):
        shutil.copy(ROOT / "params/ocean_rambler.toml", tmp_path / name)
    log = REPLAY / "tank_pni_volz.BIN"
    for name in ("STATE", "DIR", "state", "runs/tank-1/state"):
        shutil.copy(log, tmp_path / name / "logs/00000001.BIN")
    for name in ("00000001.BIN", "00000002.BIN"):
        shutil.copy(log, tmp_path / name)
    mission = {PlanKind.MISSION: [item(16, 15, 0), item(20)]}
    save_plans(tmp_path / "DIR", mission)
    assert main(["plan", "save", str(tmp_path / "survey.plan"), "--state", str(tmp_path / "DIR")]) == 0
    (tmp_path / "boat.param").write_text("CTL_K1 41\n")
    for name in ("key.txt", "account.txt"):
        (tmp_path / name).write_text(PASSPHRASE if name == "key.txt" else "user\npassword\n")
        (tmp_path / name).chmod(0o600)
    (tmp_path / "capture.bin").write_bytes(mti_protocol.encode(0x36, b""))
    manoeuvres(tmp_path)
    campaign = (ROOT / "params/campaign_twin.toml").read_text()
    few = campaign.replace("runs = 1000", "runs = 18").replace("seconds = 1200", "seconds = 730")
    (tmp_path / "params/campaign_twin.toml").write_text(few)
    for name, module in (("rambler", "firmware_py"), ("rambler-hil", "hil")):
        (tmp_path / "bin" / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n')
        (tmp_path / "bin" / name).chmod(0o755)
    return tmp_path


def manoeuvres(here):
    """Write tables with rudder and heading of a model in a zigzag."""
    heading_rad, rate_rad_s, rudder_rad, rows = 0.0, 0.0, 0.35, ["time_s,heading_rad,rudder_rad"]
    for number in range(15_000):
        if number % 10 == 0:
            rows.append(f"{number / 10:.1f},{heading_rad:.6f},{rudder_rad:.4f}")
        if heading_rad * rudder_rad > 0.0 and abs(heading_rad) > 0.35:
            rudder_rad = -rudder_rad
        rate_rad_s += 0.1 * (0.049 * rudder_rad - rate_rad_s) / 4.0
        heading_rad += 0.1 * rate_rad_s
    for name in ("zigzag.csv", "circles.csv", "voyage.csv"):
        (here / name).write_text("\n".join(rows) + "\n")


def shortened(command, number):
    """Return the command line as run by the test, and the expected exit codes."""
    for output, meant in PLACES.items():
        command = command.replace(output, meant)
    command = re.sub(r"^sudo (-u \w+ )?", "", command)
    command = re.sub(r"^make ", f"make -n -C {ROOT} ", command)  # as it is, it installs packages
    words = " ".join(command.split()[:2])
    if words in UNTIL_ENDED:
        return f"timeout --signal=INT {LIVES_S} {command}", {0, 124}
    return f"{command} {SHORT.get(words, '').format(number=number)}", {0, 1} if words in FINDING else {0}


def run_here(line, monkeypatch, capsys):
    """Run a command of `rambler` in this process, which saves its start; return its exit code and output."""
    words = [
        name
        for word in shlex.split(line)[1:]
        for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(PASSPHRASE.encode())))
    code = main(words)
    return code, "".join(capsys.readouterr())


def run_there(line, place):
    """Run a line of a shell."""
    env = {**os.environ, "PATH": f"{place / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    done = subprocess.run(
        ["bash", "-c", line], cwd=place, env=env, input=PASSPHRASE, capture_output=True, text=True, check=False,
        timeout=PATIENCE_S,
    )  # fmt: skip
    return done.returncode, done.stdout[-500:] + done.stderr


@pytest.mark.parametrize("some", list(pages()))
def test_the_commands_of_a_page_run(place, some, monkeypatch, capsys):
    monkeypatch.chdir(place)
    lines = [(name, command, is_quick(commands)) for name, commands in some for command in commands]
    for number, (name, command, quick) in enumerate(lines):
        if command.startswith("rambler example"):
            (place / "boat.toml").unlink()
            (place / "etc/boat.toml").unlink()
        line, right = shortened(command, number)
        here = quick and not line.startswith("make")
        code, output = run_here(line, monkeypatch, capsys) if here else run_there(line, place)
        assert code in right, (name, line, output)


def test_every_command_block_that_is_not_run_has_a_reason():
    found = list(blocks())
    assert len(found) > 40
    assert [name for name, reason, _ in found if reason is not None and len(reason) < 15] == []
