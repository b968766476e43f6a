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
EARLY_LOG = ROOT / "tests/replay/early_layout.BIN"  # forty ticks, written by version e343f391


def write_with_checkpoint(path, change):
    """Write the first second of a log with a changed checkpoint; return its path as a string."""
    data = LOG.read_bytes()
    records = [(fmt, data[at : at + fmt.length], at) for fmt, at in Parser(data)]
    first_tick_number = next(number for number, (fmt, _, _) in enumerate(records) if fmt.name == "TICK")
    ends = [number for number, (fmt, _, _) in enumerate(records) if fmt.name == "END"]
    text = "".join(
        fmt.unpack(record, 0)[-1][: fmt.unpack(record, 0)[-2]].decode()
        for fmt, record, _ in records[: ends[0]]
        if fmt.name == "CHK"
    )
    tick, sequence = records[first_tick_number], records[ends[0]][0].unpack(records[ends[0]][1], 0)[1]
    state = schema.CHECKPOINT.pack_text(1.0, Tick(0, 1.0, 0.0, 0, 10.0), change(text))
    other_records = [record for fmt, record, _ in records[first_tick_number + 1 : ends[0]] if fmt.name != "CHK"]
    batch = schema.append_end(tick[1] + state + b"".join(other_records), 1.0, sequence)
    second_tick, end = (records[number][2] + records[number][0].length for number in (ends[0], ends[10]))
    path.write_bytes(data[: tick[2]] + batch + data[second_tick:end])
    return str(path)


def json_edit(change):
    """Return a function that changes the fields of a checkpoint."""

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
    def rewrite(text):
        state, notes = state_codec.state_from_text(text)
        assert notes == ()
        return state_codec.state_to_text(state)

    assert main(["replay", write_with_checkpoint(tmp_path / "again.BIN", rewrite)]) == 0
    assert "note" not in capsys.readouterr().out


def test_unknown_fields_are_noted(tmp_path, capsys):
    edit = json_edit(lambda data: data.update(version=99, tide_m=1.0, idle=None))
    main(["replay", write_with_checkpoint(tmp_path / "later.BIN", edit)])
    text = f"note: State: written by a later version (99, here {state_codec.VERSION}), read by name\n"
    assert text in capsys.readouterr().out
    path = write_with_checkpoint(tmp_path / "more.BIN", json_edit(lambda data: data.update(tide_m=1.0)))
    assert main(["replay", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"] == ["State: field 'tide_m' is not known here, ignored"]


def test_invalid_parameter_and_changed_state_are_reported(tmp_path, capsys):
    edit = json_edit(lambda data: data["parameters"].update(CTL_K1=1e9))
    assert main(["replay", write_with_checkpoint(tmp_path / "less.BIN", edit)]) in (0, 1)
    assert "CTL_K1: 1e+09 is out of range" in capsys.readouterr().out
    edit = json_edit(lambda data: data["rudder"].update(command_rad=0.2))
    assert main(["replay", write_with_checkpoint(tmp_path / "other.BIN", edit)]) == 1
    assert re.search(r"commands differ, by up to \d\S* rad; the first at tick", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("change", "lines"),
    [
        (lambda data, _: data, []),
        (lambda data, at: data[:at] + b"junk" + data[at:], ["0 damaged ticks, 4 unreadable bytes"]),
        (lambda data, at: data[: at + 20] + b"\xff" + data[at + 21 :],
         ["1 gaps: dropped or damaged ticks", "1 damaged ticks, 0 unreadable bytes"]),
        (lambda data, at: data[: at + 90], ["the last tick is incomplete: 90 bytes ignored"]),
    ],
)  # fmt: skip
def test_damage_is_reported(tmp_path, capsys, change, lines):
    data = LOG.read_bytes()
    tick_offsets = [at for fmt, at in Parser(data) if fmt.name == "TICK"]
    (tmp_path / "a.BIN").write_bytes(change(data[: tick_offsets[10]], tick_offsets[5]))
    main(["replay", str(tmp_path / "a.BIN")])
    assert capsys.readouterr().out.splitlines()[1:-1] == lines


@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 5000, bytes(range(256)) * 40, b"\xa3\x95\x80" * 100, b"# no log\n" * 50, LOG.read_bytes()[:3000]],
    ids=["empty", "zeros", "bytes", "sync bytes", "text", "header"],
)
def test_file_that_is_not_a_log_is_a_one_line_error(tmp_path, capsys, content):
    (tmp_path / "no.BIN").write_bytes(content)
    assert "no whole tick in it" in refused(capsys, tmp_path / "no.BIN")


@pytest.mark.parametrize(
    "change",
    [lambda _: "", lambda _: "[" * 100_000, lambda text: text[:-10], lambda _: "{}", lambda _: "[]"],
    ids=["empty", "nested", "cut", "object", "array"],
)
def test_invalid_checkpoint_is_a_one_line_error(tmp_path, capsys, change):
    assert "checkpoint refused" in refused(capsys, write_with_checkpoint(tmp_path / "bad.BIN", change))


def shorten_filter(data):
    data["heading_estimator"]["tick"]["filter"] |= {"information": [1.0] * 17, "levels": "AAAA", "pairs": 7}


def enlarge_indexes(data):
    data["fault_latch"] |= {"since_s": [], "last_present_s": [0.0], "active": 1 << 40}
    data["guidance"]["mission"]["index"] = 10**300


@pytest.mark.parametrize("change", [shorten_filter, enlarge_indexes])
def test_impossible_numbers_cause_no_traceback(tmp_path, capsys, change):
    code = main(["replay", write_with_checkpoint(tmp_path / "odd.BIN", json_edit(change))])
    output = capsys.readouterr()
    assert (code == 0) == (" every" in output.out.replace("\n", " "))
    assert output.err.count("\n") == (code == 2)


def test_any_exception_is_a_one_line_error(monkeypatch, capsys):
    def raise_error(*_):
        raise MemoryError("two\nlines")

    monkeypatch.setattr(command, "step", raise_error)
    assert "tick 0 cannot be recomputed (MemoryError: two lines)" in refused(capsys, LOG)
    monkeypatch.setattr(command, "replay_log", raise_error)
    assert "cannot be read (MemoryError: two lines)" in refused(capsys, LOG)


def test_refusal_of_an_early_log_names_the_version_that_wrote_it(capsys):
    line = refused(capsys, EARLY_LOG)
    reason = "written as text by an early development version, which this version cannot read"
    assert f"{EARLY_LOG}: checkpoint refused ({reason}): replay it with the version of rambler that wrote it (" in line
    assert re.search(r"\(rambler 0\.1\.0.*\)$", line.rstrip())


@pytest.mark.parametrize("is_same_version", [False, True])
def test_difference_is_explained_only_for_another_version(capsys, monkeypatch, is_same_version):
    def changed_step(state, inputs):
        state, output = step(state, inputs)
        return state, replace(output, command=replace(output.command, shaft_rad=1.01 * output.command.shaft_rad))

    monkeypatch.setattr(command, "step", changed_step)
    if is_same_version:
        reader = LogReader(LOG)
        list(reader)
        monkeypatch.setattr(command, "commit_of", lambda _root: "")
        monkeypatch.setattr(command, "version_text", lambda _program, _commit: reader.reading.software)
    assert main(["replay", str(LOG)]) == 1
    *_, note, verdict = capsys.readouterr().out.splitlines()
    assert verdict == "NOT identical"
    text = r"log written by rambler 0\.1\.0.*, recomputed by rambler .*: a difference is expected"
    assert bool(re.fullmatch(text, note)) is not is_same_version
