"""Checks of a new version before it is installed, with programs that give known results."""

import json
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from firmware_py.install import self_check
from firmware_py.install.bundle import UpdateError
from firmware_py.install.environment import Environment
from firmware_py.install.self_check import CHECKS, Candidate


@pytest.fixture
def candidate(tmp_path):
    for name in ("state/logs", "work/state", "new/bin"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "boat.toml").touch()
    bundle = SimpleNamespace(title="9.9.9 (git abcd1234)")
    return Candidate(
        Environment(tmp_path / "new"), bundle, tmp_path / "boat.toml", tmp_path / "state", tmp_path / "work"
    )


@pytest.fixture
def programs(monkeypatch):
    """Let programs end with these results, in order; return the commands that were run."""
    results, commands = [], []

    def run(arguments, _timeout_s=0.0):
        commands.append(arguments)
        code, output, error = results.pop(0)
        return subprocess.CompletedProcess(arguments, code, output, error)

    monkeypatch.setattr(self_check, "_run", run)
    return SimpleNamespace(results=results, commands=commands)


def finding(subject, level, text):
    return {"subject": subject, "level": level, "text": text}


@pytest.mark.parametrize(
    ("findings", "line"),
    [
        ([], "read completely"),
        ([finding("compass", "fail", "no port")], "read completely"),
        ([finding("state", "ok", "fine"), finding("parameters", "warn", "unknown X")], "unknown X"),
        ([finding("state", "warn", "a"), finding("state", "warn", "b")], "a; b"),
    ],
)
def test_findings_about_state_and_parameters_are_reported(candidate, programs, findings, line):
    programs.results.append((1, json.dumps({"findings": findings}), ""))
    assert CHECKS["state"](candidate) == line
    (command,) = programs.commands
    assert command[1:] == [
        "check",
        str(candidate.work / "dry.toml"),
        "--state",
        str(candidate.work / "state"),
        "--json",
    ]


def test_state_that_the_new_version_cannot_use_prevents_the_update(candidate, programs):
    findings = [finding("state", "warn", "old"), finding("state", "fail", "broken")]
    programs.results.append((1, json.dumps({"findings": findings}), ""))
    with pytest.raises(UpdateError, match=r"cannot .*: broken"):
        CHECKS["state"](candidate)
    for output in ("", "[]", "{}", '{"findings": [1]}'):
        programs.results.append((1, output, "first\nlast line"))
        with pytest.raises(UpdateError, match="preflight check of the new version fails: last line"):
            CHECKS["state"](candidate)


def test_program_must_report_the_version_of_its_bundle(candidate, programs):
    programs.results += [(0, "", ""), (0, "rambler 9.9.9 (git abcd1234)\n", "")]
    assert CHECKS["program"](candidate) == "rambler 9.9.9 (git abcd1234)"
    programs.results += [(0, "", ""), (0, "rambler 9.9.8\n", "")]
    with pytest.raises(UpdateError, match=r"'rambler 9\.9\.8', its bundle"):
        CHECKS["program"](candidate)
    programs.results.append((1, "", "ImportError: no numpy\n"))
    with pytest.raises(UpdateError, match="cannot be imported: ImportError: no numpy"):
        CHECKS["program"](candidate)
    programs.results.append((1, "x" * 301, ""))
    with pytest.raises(UpdateError, match=f"cannot be imported: {'x' * 300}$"):
        CHECKS["program"](candidate)
    programs.results += [(0, "", ""), (3, "", "")]
    with pytest.raises(UpdateError, match="does not run: exit code 3"):
        CHECKS["program"](candidate)


@pytest.mark.parametrize(
    ("mean_deg", "rms_deg", "result"),
    [(0.5, 1.2, "heading error 1.2 deg (rms)"), (-19.9, 1.0, "19.9 deg"), (-20.1, 1.0, None), (0.0, 20.0, None)],
)
def test_heading_error_in_simulation_must_be_below_20_deg(candidate, programs, mean_deg, rms_deg, result):
    (candidate.work / "box").mkdir()
    goals = [{"mean_error_deg": 90.0, "rms_error_deg": 90.0}, {"mean_error_deg": mean_deg, "rms_error_deg": rms_deg}]
    (candidate.work / "box/summary.json").write_text(json.dumps({"goals": goals}))
    (candidate.copy / "parameters.param.0").write_text("CTL_K1 30")
    (candidate.copy / "mission.plan.0").write_text("plan")
    programs.results.append((0, "", ""))
    if result is None:
        with pytest.raises(UpdateError, match="heading error of 20 deg in simulation"):
            CHECKS["box"](candidate)
    else:
        assert result in CHECKS["box"](candidate)
    assert [path.name for path in (candidate.work / "tuned").iterdir()] == ["parameters.param.0"]
    arguments = ["run", "tank", "--speed", "max", "--vehicle", candidate.vehicle, "--state", candidate.work / "tuned"]
    arguments += ["--goal", "0:0,20:30", "--seconds", "320", "--out", candidate.work / "box"]
    assert programs.commands == [[str(candidate.environment.path / "bin/rambler-hil"), *map(str, arguments)]]


@pytest.mark.parametrize(
    ("code", "text", "summary"),
    [
        (2, "not checked: no scipy", "{}"),
        (1, "fails in simulation: no scipy", "{}"),
        (0, "no results of the simulation", "{}"),
        (0, "no results of the simulation", '{"goals": []}'),
    ],
)
def test_simulation_that_refuses_is_reported_and_one_that_fails_prevents_the_update(
    candidate, programs, code, text, summary
):
    (candidate.work / "box").mkdir()
    (candidate.work / "box/summary.json").write_text(summary)
    programs.results.append((code, "", "no scipy\n"))
    if code == 2:
        assert CHECKS["box"](candidate) == text
    else:
        with pytest.raises(UpdateError, match=text):
            CHECKS["box"](candidate)


@pytest.mark.parametrize(
    ("logs", "replayed"), [((), None), ((3,), 3), ((3, 7), 3), ((1, 3, 7), 3), ((99999999, 100000000), 99999999)]
)
def test_newest_complete_log_is_replayed(candidate, programs, logs, replayed):
    for number in logs:
        (candidate.state / f"logs/{number:08d}.BIN").touch()
    programs.results.append((0, "", ""))
    line = CHECKS["newest log"](candidate)
    assert line == ("no log" if replayed is None else f"{replayed:08d}.BIN bit-identical")
    programs.results[:] = [(2, "", "cannot read\n")]
    if logs:
        assert CHECKS["newest log"](candidate) == f"{replayed:08d}.BIN: cannot read"


@pytest.mark.parametrize(("name", "limit_s"), [("program", 120), ("state", 120), ("box", 600), ("newest log", 300)])
def test_program_that_does_not_end_is_given_up(candidate, monkeypatch, name, limit_s):
    def run(command, *, timeout, **_options):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(self_check.subprocess, "run", run)
    monkeypatch.setattr(self_check, "CHECKS", {name: CHECKS[name]})
    (candidate.state / "logs/00000001.BIN").touch()
    candidate.copy.rmdir()
    if name == "newest log":
        text = "newest log: 00000001.BIN not finished within 300 s, skipped"
        assert list(self_check.self_check(candidate)) == [text]
    else:
        with pytest.raises(UpdateError, match=f"^{name}: not finished within {limit_s} s$"):
            list(self_check.self_check(candidate))


@pytest.mark.parametrize("is_readable", [False, True])
def test_program_has_a_minute_to_report_ready(monkeypatch, is_readable):
    clock_s, bound = [100.0], SimpleNamespace(recv=lambda _size: b"READY=0\nREADY=10")
    process = SimpleNamespace(poll=lambda: None if clock_s[0] < 200.0 else 0)

    def select(*arguments):
        clock_s[0] += arguments[3]
        return ([bound] if is_readable else [],)

    monkeypatch.setattr(self_check, "time", SimpleNamespace(monotonic=lambda: clock_s[0]))
    monkeypatch.setattr(self_check, "select", SimpleNamespace(select=select))
    assert self_check._await_ready(process, bound, 100.0) is None
    assert clock_s[0] == pytest.approx(160.05, abs=0.06)


READY = """
import os, signal, socket, sys
address = "\\0" + os.environ["NOTIFY_SOCKET"][1:]
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
print("first\\nlast words", flush=True)
socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto({message!r}, address)
{end}
"""


@pytest.mark.parametrize(
    ("message", "end", "starts"),
    [
        (b"STATUS=x\nREADY=1", "signal.sigwait([signal.SIGTERM])", True),
        (b"READY=1", "signal.sigwait([signal.SIGTERM]); sys.exit(1)", False),
        (b"READY=0", "", False),
        (b"NOT READY=1", "", False),
        (b"READY=1", "open(os.environ['FIFO']).close()", False),
    ],
)
def test_program_must_report_ready_run_on_and_end_without_an_error(candidate, monkeypatch, message, end, starts):
    processes, waits_s, popen, fifo = [], [], subprocess.Popen, candidate.work / "fifo"
    os.mkfifo(fifo)

    def sleep(seconds):
        waits_s.append(seconds)
        if "FIFO" in end:
            fifo.write_bytes(b"")  # the program ends during this wait
            processes[0].wait(60.0)

    monkeypatch.setenv("FIFO", str(fifo))
    monkeypatch.setattr(self_check, "time", SimpleNamespace(monotonic=time.monotonic, sleep=sleep))
    monkeypatch.setattr(
        subprocess, "Popen", lambda *a, **options: processes.append(popen(*a, **options)) or processes[0]
    )
    program = candidate.environment.program
    program.write_text(f"#!{sys.executable}\n{READY.format(message=message, end=end)}")
    program.chmod(0o755)
    if starts:
        assert CHECKS["start"](candidate).startswith("control loop ready after ")
    else:
        with pytest.raises(UpdateError, match="does not start: last words"):
            CHECKS["start"](candidate)
    assert waits_s == ([3.0] if message.endswith(b"READY=1") and b"NOT" not in message else [])
