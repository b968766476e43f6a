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


@pytest.fixture
def ticks(tmp_path, fake):
    return list(LogReader(fake.write_log(tmp_path, 12)))


def flip_bit(value, bit=0):
    (bits,) = struct.unpack("<Q", struct.pack("<d", value))
    return struct.unpack("<d", struct.pack("<Q", bits ^ (1 << bit)))[0]


def state_after(ticks, fake):
    state = fake.state_from(ticks[0].checkpoint)
    for tick in ticks:
        state, _ = fake.step(state, tick.inputs)
    return fake.to_text(state)


def test_a_log_replays_to_the_same_bits(tmp_path, ticks, fake):
    report = replay_log(tmp_path / "00000001.BIN", fake.restore, fake.step)
    assert report.identical
    assert (report.ticks, report.compared, report.gaps, report.differences) == (12, 12, 0, 0)
    assert report.reading.software == "Rambler test"
    assert any(tick.command.shaft_rad != 0.0 for tick in ticks)


def test_a_changed_sample_is_reported_as_the_first_difference(ticks, fake):
    tick = ticks[7]
    sample = replace(tick.inputs.headings[0], heading_rad=flip_bit(tick.inputs.headings[0].heading_rad, 24))
    ticks[7] = replace(tick, inputs=replace(tick.inputs, headings=(sample, *tick.inputs.headings[1:])))
    report = replay(ticks, fake.restore, fake.step)
    difference = report.first_difference
    assert not report.identical
    assert (difference.tick, difference.t_s, difference.logged) == (7, tick.inputs.tick.t_s, tick.command)
    assert report.compared == 12
    assert 1 <= report.differences <= 5
    assert report.largest_rad >= abs(difference.recomputed.shaft_rad - difference.logged.shaft_rad) > 0.0


def test_the_largest_difference_of_commands_is_reported(ticks, fake):
    for number, difference_rad in ((4, 1e-3), (5, -0.25), (6, 0.1)):
        command = ticks[number].command
        ticks[number] = replace(ticks[number], command=replace(command, shaft_rad=command.shaft_rad + difference_rad))
    assert replay(ticks, fake.restore, fake.step).largest_rad == pytest.approx(0.25)
    ticks[7] = replace(ticks[7], command=replace(ticks[7].command, shaft_rad=math.nan))
    report = replay(ticks, fake.restore, fake.step)
    assert report.largest_rad == math.inf
    assert report.as_dict()["largest_rad"] is None


@pytest.mark.parametrize(
    "change",
    [
        lambda command: replace(command, shaft_rad=flip_bit(command.shaft_rad)),
        lambda command: replace(command, torque_on=not command.torque_on),
        lambda command: replace(command, shaft_rad=math.nan),
    ],
    ids=["bit", "torque", "nan"],
)
def test_a_changed_command_is_found(ticks, fake, change):
    ticks[5] = replace(ticks[5], command=change(ticks[5].command))
    report = replay(ticks, fake.restore, fake.step)
    assert (report.differences, report.first_difference.tick) == (1, 5)


@pytest.mark.parametrize(
    ("logged_rad", "recomputed_rad", "is_identical"), [(0.0, 0.0, True), (0.0, -0.0, False), (math.nan, math.nan, True)]
)
def test_zeros_differ_by_sign_and_nan_equals_itself(ticks, fake, logged_rad, recomputed_rad, is_identical):
    def step(state, inputs):
        return state, Output(RudderCommand(recomputed_rad, True), fake.step(state, inputs)[1].snapshot)

    logged = [replace(ticks[0], command=RudderCommand(logged_rad, True))]
    assert replay(logged, fake.restore, step).identical is is_identical


def test_after_a_gap_the_replay_continues_at_the_next_checkpoint(ticks, fake):
    checkpoint = state_after(ticks[:8], fake)
    with_gap = [*ticks[:3], replace(ticks[5], gap=True), *ticks[6:8], replace(ticks[8], checkpoint=checkpoint)]
    report = replay([*with_gap, *ticks[9:]], fake.restore, fake.step)
    assert (report.ticks, report.compared, report.gaps, report.differences) == (10, 7, 1, 0)
    assert not report.identical  # three ticks are not verified


def test_a_gap_followed_by_a_checkpoint_is_identical(ticks, fake):
    after_gap = replace(ticks[6], gap=True, checkpoint=state_after(ticks[:6], fake))
    report = replay([*ticks[:3], after_gap, *ticks[7:]], fake.restore, fake.step)
    assert report.identical
    assert (report.ticks, report.gaps) == (9, 1)


def test_a_truncated_log_replays_to_its_last_whole_tick(tmp_path, fake):
    data = fake.write_log(tmp_path, 3)
    ends = [offset + record.length for record, offset in Parser(data) if record.name == "END"]
    for size in {*ends, *(end - 1 for end in ends[1:])}:
        report = replay_log(data[:size], fake.restore, fake.step)
        assert report.identical
        assert report.compared == sum(end <= size for end in ends)


def test_a_damaged_last_tick_is_not_identical(tmp_path, fake):
    data = bytearray(fake.write_log(tmp_path, 3))
    data[-60] ^= 1
    report = replay_log(bytes(data), fake.restore, fake.step)
    assert (report.compared, report.differences, report.reading.damaged) == (2, 0, 1)
    assert not report.identical


def test_a_log_that_cannot_be_replayed_is_refused_with_the_reason(tmp_path, ticks, fake):
    invalid = [replace(ticks[0], checkpoint='{"smoothed_rad":1.0}')]
    for refused, reason in (([], "no whole tick"), (ticks[1:], "no checkpoint"), (invalid, "checkpoint refused")):
        with pytest.raises(LogError, match=reason):
            replay(refused, fake.restore, fake.step)
    path = tmp_path / "other.BIN"
    path.write_bytes(b"nothing")
    with pytest.raises(LogError, match=r"other\.BIN: no whole tick"):
        replay_log(path, fake.restore, fake.step)


def test_the_report_is_json(ticks, fake):
    assert json.loads(json.dumps(replay(ticks, fake.restore, fake.step).as_dict()))["first_difference"] is None
    ticks[5] = replace(ticks[5], command=RudderCommand(-0.0, False))
    data = json.loads(json.dumps(replay(ticks, fake.restore, fake.step).as_dict(), allow_nan=False))
    assert (data["identical"], data["ticks"], data["compared"], data["differences"]) == (False, 12, 12, 1)
    assert data["first_difference"]["tick"] == 5
    logged = {"shaft_rad": 0.0, "shaft_bits": "8000000000000000", "torque_on": False}
    assert data["first_difference"]["logged"] == logged
