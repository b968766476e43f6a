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
from firmware_py.plans.items import Command
from firmware_py.sensors import mti_protocol
from support.paths import REPLAY, ROOT
from support.plans import item, save_plans

BLOCK = re.compile(r"(?:^ *<!-- not run: ([^\n]+) -->\n\s*)?^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(
    r"^ *(?:\$ |sudo |-u \w+ )*(rambler|rambler-hil|make|python\S*|pip|pytest|openssl|apt-get|ssh\S*|scp|dask)\s"
)
HELP = re.compile(r"<!-- (help|output): .*?<!-- end -->", re.DOTALL)
# Appended options, which override earlier ones: short runs.
SHORT_RUN_OPTIONS = {
    "rambler-hil run": "--speed max --seconds 15 --out short-{number}",
    "rambler listen": "--seconds 0.2",
    "rambler-hil compare": "--seeds 1 --only paper -- calm",
    "rambler-hil tune": "--evaluations 20 --scenarios calm",
}
ENDLESS_COMMANDS = ("rambler run", "rambler view", "rambler-hil sbd-gateway", "rambler-hil serve-json")
# Exit code 1, a finding, is accepted: the devices are missing, or the logs are too short.
COMMANDS_WITH_FINDINGS = ("rambler listen", "rambler check", "rambler calibrate", "rambler energy", "rambler status")
QUICK_COMMANDS = ("make", "rambler example", "rambler plan", "rambler key", "rambler listen", "rambler calibrate")
REPLACEMENTS = {
    "/etc/rambler/": "etc/",
    "/var/lib/rambler": "DIR",
    "~/": "home/",
    "0.0.0.0": "127.0.0.1",
    " [--json]": "",
    "runs/before runs/after": "runs/twin runs/twin",
}
INTERRUPT_AFTER_S, TIMEOUT_S = 4.0, 300.0
PASSPHRASE = "a passphrase\n"


def command_blocks():
    """Yield page and line, the reason why it is not run or None, and the commands of each block of commands."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        if "_build" in page.parts:
            continue
        text = HELP.sub(lambda match: "\n" * match[0].count("\n"), page.read_text())
        for match in BLOCK.finditer(text):
            lines = match[3].replace("\\\n", " ").splitlines() if match[2] in ("", "sh", "text") else []
            prompt_lines = [line.strip()[2:] for line in lines if line.strip().startswith("$ ")]
            commands = prompt_lines or [line.strip() for line in lines]
            if commands and PROGRAM.match(commands[0]):
                name = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, match.start(3))}"
                yield name, match[1], [re.sub(r"\s+# .*", "", command) for command in commands]


def is_quick(commands):
    return all(re.sub(r"^sudo ", "", command).startswith(QUICK_COMMANDS) for command in commands)


def page_parameters():
    """Yield the blocks of each page that are run; blocks with long run times are marked as proof."""
    blocks_by_page = {}
    for name, reason, commands in command_blocks():
        if reason is None:
            blocks_by_page.setdefault((name.partition(":")[0], is_quick(commands)), []).append((name, commands))
    for (page, quick), page_blocks in blocks_by_page.items():
        yield pytest.param(
            page_blocks, id=f"{page}-{'quick' if quick else 'long'}", marks=[] if quick else pytest.mark.proof
        )


@pytest.fixture
def directory(tmp_path):
    """Directory with the files that the pages assume."""
    for name in ("etc", "home/post", "STATE/logs", "DIR/logs", "state/logs", "bin", "runs/tank-1/state/logs", "params"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("boat.toml", "etc/boat.toml"):
        shutil.copy(ROOT / "params/ocean_rambler.toml", tmp_path / name)
    log = REPLAY / "tank_pni_volz.BIN"
    for name in ("STATE", "DIR", "state", "runs/tank-1/state"):
        shutil.copy(log, tmp_path / name / "logs/00000001.BIN")
    for name in ("00000001.BIN", "00000002.BIN"):
        shutil.copy(log, tmp_path / name)
    mission = {PlanKind.MISSION: [item(Command.WAYPOINT, 15, 0), item(Command.RETURN)]}
    save_plans(tmp_path / "DIR", mission)
    assert main(["plan", "save", str(tmp_path / "survey.plan"), "--state", str(tmp_path / "DIR")]) == 0
    (tmp_path / "boat.param").write_text("CTL_K1 41\n")
    for name in ("key.txt", "account.txt"):
        (tmp_path / name).write_text(PASSPHRASE if name == "key.txt" else "user\npassword\n")
        (tmp_path / name).chmod(0o600)
    (tmp_path / "capture.bin").write_bytes(mti_protocol.encode(0x36, b""))
    write_manoeuvres(tmp_path)
    campaign = (ROOT / "params/campaign_twin.toml").read_text()
    short_campaign = campaign.replace("runs = 1000", "runs = 18").replace("seconds = 1200", "seconds = 730")
    (tmp_path / "params/campaign_twin.toml").write_text(short_campaign)
    for name, module in (("rambler", "firmware_py"), ("rambler-hil", "hil")):
        (tmp_path / "bin" / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n')
        (tmp_path / "bin" / name).chmod(0o755)
    return tmp_path


def write_manoeuvres(directory):
    """Write tables of rudder and heading of a K-T model in a zigzag."""
    heading_rad, rate_rad_s, rudder_rad, rows = 0.0, 0.0, 0.35, ["time_s,heading_rad,rudder_rad"]
    for number in range(15_000):
        if number % 10 == 0:
            rows.append(f"{number / 10:.1f},{heading_rad:.6f},{rudder_rad:.4f}")
        if heading_rad * rudder_rad > 0.0 and abs(heading_rad) > 0.35:
            rudder_rad = -rudder_rad
        rate_rad_s += 0.1 * (0.049 * rudder_rad - rate_rad_s) / 4.0
        heading_rad += 0.1 * rate_rad_s
    for name in ("zigzag.csv", "circles.csv", "voyage.csv"):
        (directory / name).write_text("\n".join(rows) + "\n")


def shorten(command, number):
    """Return the command line as run by the test, and the expected exit codes."""
    for text, replacement in REPLACEMENTS.items():
        command = command.replace(text, replacement)
    command = re.sub(r"^sudo (-u \w+ )?", "", command)
    command = re.sub(r"^make ", f"make -n -C {ROOT} ", command)  # dry run: make would install packages
    words = " ".join(command.split()[:2])
    if words in ENDLESS_COMMANDS:
        return f"timeout --signal=INT {INTERRUPT_AFTER_S} {command}", {0, 124}
    return f"{command} {SHORT_RUN_OPTIONS.get(words, '').format(number=number)}", {
        0,
        1,
    } if words in COMMANDS_WITH_FINDINGS else {0}


def run_in_process(line, monkeypatch, capsys):
    """Run a command of `rambler` in this process, which saves the start; return exit code and output."""
    words = [
        name
        for word in shlex.split(line)[1:]
        for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(PASSPHRASE.encode())))
    code = main(words)
    return code, "".join(capsys.readouterr())


def run_in_shell(line, directory):
    """Run a line in a shell; return exit code and output."""
    env = {**os.environ, "PATH": f"{directory / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    process = subprocess.run(
        ["bash", "-c", line], cwd=directory, env=env, input=PASSPHRASE, capture_output=True, text=True, check=False,
        timeout=TIMEOUT_S,
    )  # fmt: skip
    return process.returncode, process.stdout[-500:] + process.stderr


@pytest.mark.parametrize("page_blocks", list(page_parameters()))
def test_commands_of_a_page_run(directory, page_blocks, monkeypatch, capsys):
    monkeypatch.chdir(directory)
    lines = [(name, command, is_quick(commands)) for name, commands in page_blocks for command in commands]
    for number, (name, command, quick) in enumerate(lines):
        if command.startswith("rambler example"):
            (directory / "boat.toml").unlink()
            (directory / "etc/boat.toml").unlink()
        line, expected_codes = shorten(command, number)
        runs_in_process = quick and not line.startswith("make")
        code, output = run_in_process(line, monkeypatch, capsys) if runs_in_process else run_in_shell(line, directory)
        assert code in expected_codes, (name, line, output)


def test_every_command_block_that_is_not_run_has_a_reason():
    blocks = list(command_blocks())
    assert len(blocks) > 40
    assert [name for name, reason, _ in blocks if reason is not None and len(reason) < 15] == []
