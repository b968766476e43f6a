"""The inputs of ticks are read from the log bit for bit, and damage never produces a tick that was not written."""

import functools
import itertools
import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.intents import Arm, ManualRudder, Request, SetMode, SetParameter, SteerHeading, SteerPosition
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
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    Severity,
    Tick,
)
from firmware_py.common.reports import Output
from firmware_py.log.reader import LogReader
from firmware_py.log.recorder import LogRecorder
from support.link import SNAPSHOT

finite = st.floats(allow_nan=False, allow_infinity=False)
any_float = st.floats(allow_nan=False)  # in requests; comparison by repr excludes NaN
optional = st.none() | finite
flags = st.booleans()
byte_values = st.integers(0, 255)
counts = st.integers(0, 2**63)

headings = st.builds(
    HeadingSample,
    finite,
    finite,
    st.sampled_from(NorthReference),
    optional,
    optional,
    optional,
    optional,
    optional,
    byte_values,
)
satellites = st.none() | st.integers(-(2**53), 2**53)
positions = st.builds(PositionSample, finite, st.sampled_from(FixType), *[optional] * 5, satellites, optional, optional)
feedback = st.builds(
    RudderFeedback, finite, optional, optional, optional, optional, st.integers(0, 2**32 - 1), st.none() | st.booleans()
)
devices = st.builds(
    DeviceHealth, finite, st.sampled_from(DeviceRole), st.sampled_from(DeviceState), counts, counts, st.text()
)
intents = st.one_of(
    st.builds(SetMode, st.integers()),
    st.builds(Arm, flags, flags),
    st.builds(SteerHeading, any_float, flags, flags, st.integers(), flags),
    st.builds(SteerPosition, any_float, any_float, flags),
    st.builds(ManualRudder, st.none() | any_float),
    st.builds(SetParameter, st.text() | st.sampled_from(["CTL_K1", "LOOP_RATE_HZ"]), any_float),
)
requests = st.builds(Request, finite, intents, byte_values, byte_values)
ticks = st.builds(Tick, counts, finite, finite, counts, finite)


def short_tuples(strategy):
    return st.lists(strategy, max_size=3).map(tuple)


inputs_of_a_tick = st.builds(
    Inputs,
    ticks,
    short_tuples(headings),
    short_tuples(positions),
    short_tuples(feedback),
    short_tuples(devices),
    short_tuples(requests),
    rudder_angles=short_tuples(st.builds(RudderAngleSample, finite, finite)),
)
commands = st.builds(RudderCommand, any_float, flags)


def output_for(inputs, command):
    tick = inputs.tick
    snapshot = replace(SNAPSHOT, t_s=tick.t_s, tick=tick.index, rudder_command_rad=command.shaft_rad)
    return Output(command, snapshot, (Event(Severity.INFO, "é" * 40),))


def write_log(ticks_of_run, checkpoint="state"):
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
        for inputs, command in ticks_of_run:
            recorder.offer(inputs, output_for(inputs, command), lambda: checkpoint)
        recorder.close()
        assert recorder.health(0.0).rejected == 0
        return (Path(directory) / "00000001.BIN").read_bytes()


@given(ticks_of_run=st.lists(st.tuples(inputs_of_a_tick, commands), min_size=1, max_size=3), checkpoint=st.text())
def test_every_tick_is_read_back_bit_for_bit(ticks_of_run, checkpoint):
    reader = LogReader(write_log(ticks_of_run, checkpoint))
    logged = list(reader)
    assert [(tick.inputs, tick.command) for tick in logged] == ticks_of_run
    # repr distinguishes -0.0 from 0.0, True from 1 and a number from its enumeration.
    assert repr([(tick.inputs, tick.command) for tick in logged]) == repr(ticks_of_run)
    assert [tick.checkpoint for tick in logged] == [checkpoint] + [None] * (len(ticks_of_run) - 1)
    assert reader.reading.damaged == reader.reading.garbage_bytes == reader.reading.tail_bytes == 0


@functools.cache
def example_log():
    tick = [
        Inputs(Tick(n, n * 0.1, 0.0, 0, 10.0), (HeadingSample(n * 0.1, 0.1, NorthReference.TRUE),)) for n in range(8)
    ]
    return write_log([(inputs, RudderCommand(0.01 * n, True)) for n, inputs in enumerate(tick)])


@given(
    damage=st.lists(
        st.tuples(st.integers(0, 2**16), st.integers(0, 300), st.binary(max_size=100)), min_size=1, max_size=5
    )
)
def test_damage_loses_ticks_but_never_produces_one(damage):
    ticks_by_index = {tick.inputs.tick.index: (tick.inputs, tick.command) for tick in LogReader(example_log())}
    data = example_log()
    for offset, removed, inserted in damage:
        position = offset % (len(data) + 1)
        data = data[:position] + inserted + data[position + removed :]
    try:
        reader = LogReader(data)
        logged = list(reader)
    except ValueError:  # damage of the frame format: as another version
        return
    if reader.reading.notes:  # damage of a column format, which is reported
        return
    assert all((tick.inputs, tick.command) == ticks_by_index[tick.inputs.tick.index] for tick in logged)
    order = [tick.inputs.tick.index for tick in logged]
    assert order == sorted(set(order))
    for previous, tick in itertools.pairwise(logged):
        assert tick.gap == (tick.inputs.tick.index != previous.inputs.tick.index + 1)
