"""`rambler replay`: errors, notes and differences."""

import json
import re

import pytest
from msgspec.structs import replace

from firmware_py.__main__ import main
from firmware_py.cli import replay as command
from firmware_py.common.records import Tick
from firmware_py.core import state_codec
from firmware_py.core.step import step
from firmware_py.log import schema
from firmware_py.log.dataflash import Parser
from firmware_py.log.reader import LogReader
from support.paths import REPLAY, ROOT

LOG = REPLAY / "tank_pni_volz.BIN"
EARLY = ROOT / "tests/replay/early_layout.BIN"  # forty ticks that version e343f391 wrote


def with_checkpoint(path, change):
    """Write the first second of a log again, with its checkpoint changed."""
    data = LOG.read_bytes()
    records = [(found, data[at : at + found.length], at) for found, at in Parser(data)]
    first = next(number for number, (found, _, _) in enumerate(records) if found.name == "TICK")
    ends = [number for number, (found, _, _) in enumerate(records) if found.name == "END"]
    text = "".join(
        found.unpack(record, 0)[-1][: found.unpack(record, 0)[-2]].decode()
        for found, record, _ in records[: ends[0]]
        if found.name == "CHK"
    )
    tick, sequence = records[first], records[ends[0]][0].unpack(records[ends[0]][1], 0)[1]
    state = schema.CHECKPOINT.pack_text(1.0, Tick(0, 1.0, 0.0, 0, 10.0), change(text))
    rest = [record for found, record, _ in records[first + 1 : ends[0]] if found.name != "CHK"]
    batch = schema.end_bytes(tick[1] + state + b"".join(rest), 1.0, sequence)
    after = records[ends[0]][2] + records[ends[0]][0].length
    path.write_bytes(data[: tick[2]] + batch + data[after : records[ends[10]][2] + records[ends[10]][0].length])
    return str(path)


def edited(change):
    def edit(text):
        data = json.loads(text)
        change(data)
        return json.dumps(data)

    return edit


def refused(capsys, path):
    """Return the one-line error."""
    assert main(["replay", str(path)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("rambler replay: ")
    assert output.err.count("\n") == 1
    return output.err


def test_rewritten_checkpoint_replays_identically(tmp_path, capsys):
    path = with_checkpoint(tmp_path / "again.BIN", lambda text: state_codec.state_to_text(_state(text)))
    assert main(["replay", path]) == 0
    assert "note" not in capsys.readouterr().out


def _state(text):
    state, notes = state_codec.state_from_text(text)
    assert notes == ()
    return state


def test_unknown_fields_are_noted(tmp_path, capsys):
    path = with_checkpoint(tmp_path / "later.BIN", edited(lambda data: data.update(version=99, tide_m=1.0, idle=None)))
    main(["replay", path])
    assert (
        f"note: State: written by a later version (99, here {state_codec.VERSION}), read by name\n"
        in capsys.readouterr().out
    )
    path = with_checkpoint(tmp_path / "more.BIN", edited(lambda data: data.update(tide_m=1.0)))
    assert main(["replay", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"] == ["State: field 'tide_m' is not known here, ignored"]


def test_invalid_parameter_and_changed_state_are_reported(tmp_path, capsys):
    path = with_checkpoint(tmp_path / "less.BIN", edited(lambda data: data["parameters"].update(CTL_K1=1e9)))
    assert main(["replay", path]) in (0, 1)
    assert "CTL_K1: 1e+09 is out of range" in capsys.readouterr().out
    path = with_checkpoint(tmp_path / "other.BIN", edited(lambda data: data["rudder"].update(command_rad=0.2)))
    assert main(["replay", path]) == 1
    output = capsys.readouterr().out
    assert "commands differ, by up to " in output
    assert re.search(r"commands differ, by up to \d\S* rad; the first at tick", output)


@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 5000, bytes(range(256)) * 40, b"\xa3\x95\x80" * 100, b"# no log\n" * 50, LOG.read_bytes()[:3000]],
    ids=["empty", "zeros", "bytes", "marks", "text", "head"],
)
def test_file_that_is_not_a_log_is_a_one_line_error(tmp_path, capsys, content):
    (tmp_path / "no.BIN").write_bytes(content)
    assert "no whole tick in it" in refused(capsys, tmp_path / "no.BIN")


@pytest.mark.parametrize(
    "change",
    [
        lambda _: "",
        lambda _: "[" * 100_000,
        lambda text: text[:-10],
        lambda _: "{}",
        lambda _: "[]",
    ],
)
def test_invalid_checkpoint_is_a_one_line_error(tmp_path, capsys, change):
    assert "checkpoint refused" in refused(capsys, with_checkpoint(tmp_path / "bad.BIN", change))


def short_filter(data):
    data["heading_estimator"]["tick"]["filter"] |= {"information": [1.0] * 17, "levels": "AAAA", "pairs": 7}


def far_index(data):
    data["fault_latch"] |= {"since_s": [], "stood_s": [0.0], "active": 1 << 40}
    data["guidance"]["mission"]["index"] = 10**300


@pytest.mark.parametrize("change", [short_filter, far_index])
def test_impossible_numbers_cause_no_traceback(tmp_path, capsys, change):
    path = with_checkpoint(tmp_path / "odd.BIN", edited(change))
    code = main(["replay", path])
    output = capsys.readouterr()
    assert (code == 0) == (" every" in output.out.replace("\n", " "))
    assert output.err.count("\n") == (code == 2)


def test_any_exception_is_a_one_line_error(monkeypatch, capsys):
    def broken(*_):
        raise MemoryError("two\nlines")

    monkeypatch.setattr(command, "step", broken)
    assert "tick 0 cannot be recomputed (MemoryError: two lines)" in refused(capsys, LOG)
    monkeypatch.setattr(command, "replay_log", broken)
    assert "cannot be read (MemoryError: two lines)" in refused(capsys, LOG)


def test_early_log_layout_names_the_version_that_wrote_it(capsys):
    line = refused(capsys, EARLY)
    reason = "written as text by an early development version, which this version cannot read"
    assert f"{EARLY}: checkpoint refused ({reason}): replay it with the version of rambler that wrote it (" in line
    assert re.search(r"\(rambler 0\.1\.0.*\)$", line.rstrip())


@pytest.fixture
def changed_controller(monkeypatch):
    """A program whose rudder commands differ by a little."""
    monkeypatch.setattr(command, "step", changed_step)


def changed_step(state, inputs):
    state, output = step(state, inputs)
    return state, replace(output, command=replace(output.command, shaft_rad=1.01 * output.command.shaft_rad))


@pytest.mark.usefixtures("changed_controller")
def test_difference_to_another_version_is_explained(capsys):
    assert main(["replay", str(LOG)]) == 1
    output = capsys.readouterr().out.splitlines()
    assert output[-1] == "NOT identical"
    assert re.fullmatch(
        r"log written by rambler 0\.1\.0.*, recomputed by rambler .*: a difference is expected", output[-2]
    )


@pytest.mark.usefixtures("changed_controller")
def test_difference_to_the_same_version_is_not_explained(capsys, monkeypatch):
    monkeypatch.setattr(command, "commit_of", lambda _root: "")
    monkeypatch.setattr(command, "version_text", lambda _program, _commit: reading.software)
    reader = LogReader(LOG)
    list(reader)
    reading = reader.reading
    assert main(["replay", str(LOG)]) == 1
    assert "steers otherwise" not in capsys.readouterr().out
