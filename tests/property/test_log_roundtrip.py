"""Whatever a tick computes from is read back bit for bit; damage never invents a tick."""

import functools
import itertools
import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.intents import Arm, ManualRudder, Request, SetMode, SetParameter, SteerHeading, SteerPosition
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Severity,
    Tick,
)
from firmware_py.common.reports import Output, Snapshot
from firmware_py.log.dataflash import Parser
from firmware_py.log.reader import LogReader
from firmware_py.log.recorder import LogRecorder

finite = st.floats(allow_nan=False, allow_infinity=False)
anything = st.floats(allow_nan=False)  # requests are the ground's: repr distinguishes all but the payload of NaN
maybe = st.none() | finite
flags = st.booleans()
bytes_of_one = st.integers(0, 255)
counts = st.integers(0, 2**63)

headings = st.builds(
    HeadingSample, finite, finite, st.sampled_from(NorthReference), maybe, maybe, maybe, maybe, maybe, bytes_of_one
)
positions = st.builds(
    PositionSample,
    finite,
    st.sampled_from(FixType),
    *[maybe] * 5,
    st.none() | st.integers(-(2**53), 2**53),
    maybe,
    maybe,
)
feedback = st.builds(
    RudderFeedback, finite, maybe, maybe, maybe, maybe, st.integers(0, 2**32 - 1), st.none() | st.booleans()
)
devices = st.builds(
    DeviceHealth, finite, st.sampled_from(DeviceRole), st.sampled_from(DeviceState), counts, counts, st.text()
)
intents = st.one_of(
    st.builds(SetMode, st.integers()),
    st.builds(Arm, flags, flags),
    st.builds(SteerHeading, anything, flags, flags, st.integers(), flags),
    st.builds(SteerPosition, anything, anything, flags),
    st.builds(ManualRudder, st.none() | anything),
    st.builds(SetParameter, st.text() | st.sampled_from(["CTL_K1", "LOOP_RATE_HZ"]), anything),
)
requests = st.builds(Request, finite, intents, bytes_of_one, bytes_of_one)
ticks = st.builds(Tick, counts, finite, finite, counts, finite)


def few(strategy):
    return st.lists(strategy, max_size=3).map(tuple)


inputs_of_a_tick = st.builds(Inputs, ticks, few(headings), few(positions), few(feedback), few(devices), few(requests))
commands = st.builds(RudderCommand, anything, flags)


def output_for(inputs, command):
    snapshot = Snapshot(
        t_s=inputs.tick.t_s,
        tick=inputs.tick.index,
        mode=Mode.GUIDED,
        armed=True,
        heading_rad=0.1,
        heading_ok=True,
        yaw_rate_rad_s=None,
        roll_rad=None,
        pitch_rad=None,
        goal_heading_rad=None,
        heading_error_rad=None,
        bearing_rad=None,
        distance_m=None,
        rudder_rad=None,
        rudder_command_rad=command.shaft_rad,
        rudder_ok=False,
        servo=None,
        position=None,
        position_ok=False,
        faults=0,
        rate_hz=10.0,
        skipped_total=0,
        late_s=0.0,
    )
    return Output(command, snapshot, (Event(Severity.INFO, "é" * 40),))


def log_of(run, checkpoint="state"):
    with tempfile.TemporaryDirectory() as directory:
        recorder = LogRecorder(
            Path(directory),
            parameters=ParameterSet(),
            file_bytes=1 << 24,
            max_total_bytes=1 << 30,
            utc_s=0.0,
            software="Rambler",
            background=False,
        )
        for inputs, command in run:
            recorder.offer(inputs, output_for(inputs, command), lambda: checkpoint)
        recorder.close()
        assert recorder.health(0.0).rejected == 0
        return (Path(directory) / "00000001.BIN").read_bytes()


@given(run=st.lists(st.tuples(inputs_of_a_tick, commands), min_size=1, max_size=3), checkpoint=st.text())
def test_every_tick_is_read_back_bit_for_bit(run, checkpoint):
    reader = LogReader(log_of(run, checkpoint))
    read = list(reader)
    assert [(tick.inputs, tick.command) for tick in read] == run
    # repr distinguishes -0.0 from 0.0, True from 1 and a number from its enumeration.
    assert repr([(tick.inputs, tick.command) for tick in read]) == repr(run)
    assert [tick.checkpoint for tick in read] == [checkpoint] + [None] * (len(run) - 1)
    assert reader.reading.damaged == reader.reading.garbage_bytes == reader.reading.tail_bytes == 0


@functools.cache
def plain_log():
    tick = [
        Inputs(Tick(n, n * 0.1, 0.0, 0, 10.0), (HeadingSample(n * 0.1, 0.1, NorthReference.TRUE),)) for n in range(8)
    ]
    return log_of([(inputs, RudderCommand(0.01 * n, True)) for n, inputs in enumerate(tick)])


@given(
    damage=st.lists(
        st.tuples(st.integers(0, 2**16), st.integers(0, 300), st.binary(max_size=100)), min_size=1, max_size=5
    )
)
def test_damage_loses_ticks_but_never_invents_one(damage):
    whole = {tick.inputs.tick.index: (tick.inputs, tick.command) for tick in LogReader(plain_log())}
    data = plain_log()
    for at, removed, inserted in damage:
        place = at % (len(data) + 1)
        data = data[:place] + inserted + data[place + removed :]
    try:
        reader = LogReader(data)
        read = list(reader)
    except ValueError:  # the description of the frame is hit: another version
        return
    if reader.reading.notes:  # the description of a column is hit, which is said
        return
    assert all((tick.inputs, tick.command) == whole[tick.inputs.tick.index] for tick in read)
    order = [tick.inputs.tick.index for tick in read]
    assert order == sorted(set(order))
    for before, tick in itertools.pairwise(read):
        assert tick.gap == (tick.inputs.tick.index != before.inputs.tick.index + 1)


@given(st.lists(st.binary(max_size=40) | st.just(b"\xa3\x95\x80") | st.just(b"\xa3\x95"), max_size=40).map(b"".join))
def test_any_bytes_are_parsed_to_the_end(data):
    parser = Parser(data)
    found = sum(one.length for one, _ in parser)
    assert found + parser.garbage_bytes + parser.tail_bytes == len(data)
    assert list(LogReader(data)) == []
