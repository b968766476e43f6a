import json
import math
import struct

import pytest
from msgspec.structs import replace

from firmware_py.common.records import RudderCommand
from firmware_py.common.reports import Output
from firmware_py.log.dataflash import LogError, Parser
from firmware_py.log.reader import LogReader
from firmware_py.log.replay import replay, replay_log


def replayed(ticks, pretend):
    return replay(ticks, pretend.restore, pretend.step)


@pytest.fixture
def ticks(tmp_path, pretend):
    return list(LogReader(pretend.logged(tmp_path, 12)))


def flipped(value, bit=0):
    (bits,) = struct.unpack("<Q", struct.pack("<d", value))
    return struct.unpack("<d", struct.pack("<Q", bits ^ (1 << bit)))[0]


def test_a_log_replays_to_the_same_bits(tmp_path, pretend):
    pretend.logged(tmp_path, 12)
    report = replay_log(tmp_path / "00000001.BIN", pretend.restore, pretend.step)
    assert report.identical
    assert (report.ticks, report.compared, report.gaps, report.differences) == (12, 12, 0, 0)
    assert report.reading.software == "Rambler test"
    assert any(tick.command.shaft_rad != 0.0 for tick in LogReader(tmp_path / "00000001.BIN"))


def test_one_bit_of_one_sample_is_found(ticks, pretend):
    tick = ticks[7]
    sample = replace(tick.inputs.headings[0], heading_rad=flipped(tick.inputs.headings[0].heading_rad, 24))
    ticks[7] = replace(tick, inputs=replace(tick.inputs, headings=(sample, *tick.inputs.headings[1:])))
    report = replayed(ticks, pretend)
    assert not report.identical
    assert report.first_difference.tick == 7
    assert report.first_difference.t_s == tick.inputs.tick.t_s
    assert report.first_difference.logged == tick.command
    assert report.first_difference.recomputed != tick.command
    assert report.compared == 12
    assert 1 <= report.differences <= 5
    first = report.first_difference
    assert report.largest_rad >= abs(first.recomputed.shaft_rad - first.logged.shaft_rad) > 0.0


def test_the_largest_difference_of_commands_is_reported(ticks, pretend):
    for number, off_rad in ((4, 1e-3), (5, -0.25), (6, 0.1)):
        command = ticks[number].command
        ticks[number] = replace(ticks[number], command=replace(command, shaft_rad=command.shaft_rad + off_rad))
    assert replayed(ticks, pretend).largest_rad == pytest.approx(0.25)
    ticks[7] = replace(ticks[7], command=replace(ticks[7].command, shaft_rad=math.nan))
    report = replayed(ticks, pretend)
    assert report.largest_rad == math.inf
    assert report.as_dict()["largest_rad"] is None


@pytest.mark.parametrize(
    "change",
    [
        lambda command: replace(command, shaft_rad=flipped(command.shaft_rad)),
        lambda command: replace(command, torque_on=not command.torque_on),
        lambda command: replace(command, shaft_rad=math.nan),
    ],
)
def test_one_bit_of_one_decision_is_found(ticks, pretend, change):
    ticks[5] = replace(ticks[5], command=change(ticks[5].command))
    report = replayed(ticks, pretend)
    assert (report.differences, report.first_difference.tick) == (1, 5)


def test_the_sign_of_zero_counts_and_a_nan_is_itself(ticks, pretend):
    def always(shaft_rad):
        def step(state, inputs):
            _, output = pretend.step(state, inputs)
            return state, Output(RudderCommand(shaft_rad, True), output.snapshot)

        return step

    def logged_as(shaft_rad):
        return [replace(ticks[0], command=RudderCommand(shaft_rad, True))]

    assert replay(logged_as(0.0), pretend.restore, always(0.0)).identical
    assert not replay(logged_as(0.0), pretend.restore, always(-0.0)).identical
    assert replay(logged_as(math.nan), pretend.restore, always(math.nan)).identical


def test_after_a_gap_the_next_checkpoint_goes_on(ticks, pretend):
    checkpoint = ticks[0].checkpoint
    state = pretend.state_from(checkpoint)
    for tick in ticks[:8]:
        state, _ = pretend.step(state, tick.inputs)
    holed = [*ticks[:3], replace(ticks[5], gap=True), *ticks[6:8], replace(ticks[8], checkpoint=pretend.to_text(state))]
    report = replayed([*holed, *ticks[9:]], pretend)
    assert (report.ticks, report.compared, report.gaps, report.differences) == (10, 7, 1, 0)
    assert not report.identical  # three ticks are not verified


def test_a_gap_with_its_checkpoint_is_whole(ticks, pretend):
    state = pretend.state_from(ticks[0].checkpoint)
    for tick in ticks[:6]:
        state, _ = pretend.step(state, tick.inputs)
    report = replayed([*ticks[:3], replace(ticks[6], gap=True, checkpoint=pretend.to_text(state)), *ticks[7:]], pretend)
    assert report.identical
    assert (report.ticks, report.gaps) == (9, 1)


def test_a_log_cut_anywhere_replays_up_to_there(tmp_path, pretend):
    data = pretend.logged(tmp_path, 3)
    ends = [at + found.length for found, at in Parser(data) if found.name == "END"]
    for cut in {*range(ends[0], len(data), 23), *ends, *(end - 1 for end in ends[1:])}:
        report = replay_log(data[:cut], pretend.restore, pretend.step)
        assert report.identical
        assert report.compared == sum(end <= cut for end in ends)


def test_damage_is_not_identical_even_where_nothing_follows(tmp_path, pretend):
    data = bytearray(pretend.logged(tmp_path, 3))
    data[-60] ^= 1
    report = replay_log(bytes(data), pretend.restore, pretend.step)
    assert (report.compared, report.differences, report.reading.damaged) == (2, 0, 1)
    assert not report.identical


def test_a_log_that_cannot_be_replayed_says_why(tmp_path, ticks, pretend):
    with pytest.raises(LogError, match="no whole tick"):
        replayed([], pretend)
    with pytest.raises(LogError, match="no checkpoint"):
        replayed(ticks[1:], pretend)
    with pytest.raises(LogError, match="checkpoint refused"):
        replayed([replace(ticks[0], checkpoint='{"smoothed_rad":1.0}')], pretend)
    path = tmp_path / "other.BIN"
    path.write_bytes(b"nothing")
    with pytest.raises(LogError, match=r"other\.BIN: no whole tick"):
        replay_log(path, pretend.restore, pretend.step)


def test_the_report_is_json(ticks, pretend):
    assert json.loads(json.dumps(replayed(ticks, pretend).as_dict()))["first_difference"] is None
    ticks[5] = replace(ticks[5], command=RudderCommand(-0.0, False))
    data = json.loads(json.dumps(replayed(ticks, pretend).as_dict(), allow_nan=False))
    assert data["identical"] is False
    assert (data["ticks"], data["compared"], data["differences"]) == (12, 12, 1)
    assert data["first_difference"]["tick"] == 5
    assert data["first_difference"]["logged"] == {
        "shaft_rad": 0.0,
        "shaft_bits": "8000000000000000",
        "torque_on": False,
    }
