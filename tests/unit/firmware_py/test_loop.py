"""The fixed-rate loop with a simulated clock: ticks, link service, plans, restart, safe end."""

import itertools
import math
from dataclasses import fields

import pytest

from firmware_py.common import records
from firmware_py.common.intents import (
    Arm,
    ForgetParameters,
    Request,
    Restart,
    SetMode,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import parse_file
from firmware_py.common.records import DeviceRole, HeadingSample, NorthReference, RudderFeedback
from firmware_py.core.resume import from_bytes as resume_from_bytes
from firmware_py.loop import LoopParts, make_safe, run
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.state_directory import PARAMETER_FILE, RESUME_FILE
from support.loop_parts import (
    FakeCompass,
    FakeDevice,
    FakeLink,
    FakePosition,
    event_texts,
    make_boat,
    run_for,
    set_parameter,
    ticks,
)


@pytest.fixture
def boat():
    """Return the parts of the loop on a boat whose devices, link and store are fakes."""
    return make_boat()


SAFE_INTERVAL_S = 0.1


def test_ticks_start_at_their_absolute_deadlines(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 2.0)
    assert [tick.index for tick in ticks(boat)] == list(range(len(ticks(boat))))
    assert [tick.t_s for tick in ticks(boat)] == pytest.approx([0.1 * index for index in range(len(ticks(boat)))])
    assert all(tick.late_s == 0.0 and tick.skipped == 0 for tick in ticks(boat))


def test_rudder_command_is_sent_before_the_link_publishes(boat):
    run_for(boat, 0.25)
    order = [call for call, _ in boat.link.call_log if call in ("command", "publish")]
    assert order[:4] == ["command", "publish", "command", "publish"]


def test_deadlines_missed_in_a_stall_are_skipped_in_phase_and_reported(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    stall = iter([0.0] * 5 + [0.73])

    def publish(output, now_s):
        boat.clock.t_s += next(stall, 0.0)

    boat.link.publish = publish
    run_for(boat, 3.0)
    assert sum(tick.skipped for tick in ticks(boat)) == 6
    late_tick = next(tick for tick in ticks(boat) if tick.skipped)
    assert late_tick.t_s == pytest.approx(1.2)
    assert late_tick.late_s == pytest.approx(0.03)
    assert ticks(boat)[-1].t_s == pytest.approx(round(ticks(boat)[-1].t_s, 1))


class FakeLine:
    """A closed port that records the times at which it is reopened."""

    written = 0

    def __init__(self):
        self.reopen_times_s = []

    def reopen(self, now_s):
        self.reopen_times_s.append(now_s)
        return "port a: Permission denied" if len(self.reopen_times_s) == 3 else ""


def test_last_tick_opens_no_port(boat):
    """After the harness is killed, another process may own the paths of its ptys."""
    line = FakeLine()
    boat.lines = [line]
    run_for(boat, 1.0)
    assert line.reopen_times_s == [tick.t_s + tick.late_s for tick in ticks(boat)[:-1]]
    problem = records.Event(records.Severity.WARNING, "port a: Permission denied")
    reported = [number for number, (_, output, _) in enumerate(boat.recorder.ticks) if problem in output.events]
    assert reported == [3]  # in the tick after the attempt


def test_sample_is_read_when_it_arrives(boat):
    boat.clock.arrivals = [(0.137, boat.compass.fileno())]
    run_for(boat, 0.3)
    assert 0.137 in boat.compass.receive_times_s


def test_servo_reply_wakes_the_loop_only_if_prompt_io_is_needed(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.rudder.descriptor = 11
    boat.clock.arrivals = [(t_s, boat.rudder.descriptor) for t_s in (0.104, 0.214, 0.216)]

    def publish(_output, now_s):
        boat.rudder.prompt_replies = 1 if now_s == pytest.approx(0.2) else 0

    boat.link.publish = publish
    run_for(boat, 0.35)
    receive_times_s = [now_s for now_s in boat.rudder.receive_times_s if now_s < 0.35]
    assert receive_times_s[:5] == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.3], abs=1e-3)


def test_loop_does_not_wait_on_a_closed_port(boat):
    descriptor = boat.compass.fileno()
    boat.clock.arrivals = [(0.137, descriptor), (0.15, descriptor)]
    boat.compass.receive = lambda now_s: setattr(boat.compass, "fileno", lambda: -1) if now_s > 0.13 else None
    run_for(boat, 0.35)
    wait_times_s = [now_s for now_s, _, descriptors in boat.clock.waits if descriptor in descriptors]
    assert max(wait_times_s) < 0.137
    assert not any(-1 in descriptors for _, _, descriptors in boat.clock.waits)


def test_battery_monitor_is_read_at_the_ticks(boat):
    power = FakeDevice(DeviceRole.POWER, 12)
    boat.power = (power,)
    boat.__post_init__()
    boat.clock.arrivals = [(0.137, power.fileno())]
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 0.35)
    assert power.receive_times_s == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("is_prompt", [True, False])
def test_second_compass_wakes_the_loop_unless_it_is_a_gyroscope(boat, is_prompt):
    boat.compass_b, boat.compass_b_is_prompt = FakeCompass(DeviceRole.COMPASS_B, 12), is_prompt
    boat.__post_init__()
    assert boat.compass_b in boat.devices
    boat.clock.arrivals = [(0.137, boat.compass_b.fileno())]
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 0.35)
    expected_s = [0.0, 0.1, 0.137, 0.2, 0.3] if is_prompt else [0.0, 0.1, 0.2, 0.3]
    assert boat.compass_b.receive_times_s == pytest.approx(expected_s)


def test_ticks_drift_to_shortly_after_the_compass_samples(boat):
    boat.compass.receive = lambda now_s: None
    boat.clock.arrivals = []
    phase_s = 0.04

    def poll():
        newest_s = phase_s + 0.1 * math.floor((boat.clock.t_s - phase_s) / 0.1 + 1e-9)
        return [HeadingSample(newest_s, 1.0, NorthReference.TRUE)] if newest_s > 0.0 else []

    boat.compass.poll = poll
    run_for(boat, 60.0)
    assert (ticks(boat)[-1].t_s - phase_s) % 0.1 == pytest.approx(0.002, abs=2e-4)


@pytest.mark.parametrize(
    ("tick_on_compass", "lock", "sample_s", "is_complete", "start_s"),
    [
        (True, 1, 0.098, True, 0.098),
        (True, 1, 0.098, False, 0.1),  # the sentence is incomplete
        (True, 1, 0.0962, True, 0.0962),
        (True, 1, 0.0958, True, 0.1),  # more than 4 ms before the deadline
        (True, 0, 0.098, True, 0.1),
        (False, 1, 0.098, True, 0.1),  # in lockstep with a simulator
    ],
)
def test_tick_starts_with_the_sample_that_it_is_locked_to(boat, tick_on_compass, lock, sample_s, is_complete, start_s):
    boat.tick_on_compass = tick_on_compass
    set_parameter(boat, "LOOP_LOCK", lock)
    receive = boat.compass.receive
    boat.compass.receive = lambda now_s: receive(now_s) if now_s == sample_s and is_complete else None
    boat.clock.arrivals = [(sample_s, boat.compass.fileno())]
    run_for(boat, 0.25)
    samples = [sample.t_s for inputs, _, _ in boat.recorder.ticks for sample in inputs.headings]
    assert samples == ([sample_s] if is_complete else [])
    second, third = ticks(boat)[1:3]
    assert (second.t_s, second.late_s, third.t_s) == (pytest.approx(start_s), 0.0, pytest.approx(0.2, abs=6e-4))
    assert [time_s for call, time_s in boat.link.call_log if call == "command"][1] == pytest.approx(start_s)


def test_garbage_is_collected_once_a_minute(boat, monkeypatch):
    times_s = []
    monkeypatch.setattr("firmware_py.loop.gc.collect", lambda: times_s.append(boat.clock.t_s))
    set_parameter(boat, "LOOP_RATE_HZ", 1)
    run_for(boat, 125.0)
    assert times_s == pytest.approx([60.0, 120.0], abs=1.01)


def test_accepted_parameter_is_used_at_once_and_stored(boat):
    answer = set_parameter(boat, "CTL_K1", 44.4)
    assert answer.verdict is Verdict.ACCEPTED
    value = boat.autopilot.parameters()["CTL_K1"]
    assert value == pytest.approx(44.4)
    boat.autopilot.when_stored(lambda _is_stored: None)
    assert parse_file(boat.store.saved[PARAMETER_FILE].decode(), "x") == {"CTL_K1": value}
    assert set_parameter(boat, "CTL_K1", math.inf).verdict is Verdict.DENIED
    assert parse_file(boat.store.saved[PARAMETER_FILE].decode(), "x") == {"CTL_K1": value}


def resume_record(boat):
    return resume_from_bytes(boat.store.saved[RESUME_FILE])[0]


def test_resume_record_is_updated_at_start_ticks_and_end(boat):
    set_parameter(boat, "BOOT_RESUME", 2)
    armed_states = []  # (time, armed in the record)
    boat.link.publish = lambda output, now_s: armed_states.append((now_s, resume_record(boat).modes.armed))
    boat.link.on_service = lambda now_s: boat.autopilot.decide(Request(now_s, Arm(armed=True, force=True)))
    boat.clock.arrivals.append((0.33, FakeLink.DESCRIPTOR))
    run_for(boat, 0.75)
    # The record of a tick is saved after its publication, so it is seen in the next one.
    arming_tick_s = next(tick.t_s for tick in ticks(boat) if tick.t_s > 0.33)
    assert [armed for now_s, armed in armed_states if now_s <= arming_tick_s] == [False] * 5
    assert all(armed for now_s, armed in armed_states if now_s > arming_tick_s)
    boat.autopilot.decide(Request(boat.clock.t_s, SetMode(int(Mode.MANUAL))))
    run(boat, lambda: True)
    assert resume_record(boat).modes.mode is Mode.MANUAL


def test_no_resume_record_without_boot_resume(boat):
    run_for(boat, 1.0)
    assert RESUME_FILE not in boat.store.saved


def test_restart_ends_the_loop_after_the_logged_tick_with_a_centred_rudder(boat):
    assert boat.autopilot.decide(Request(0.0, Restart())).verdict is Verdict.ACCEPTED
    run_for(boat, 10.0)
    assert len(ticks(boat)) == 1
    assert boat.recorder.ticks[0][0].requests[0].intent == Restart()
    assert boat.autopilot.restart == Restart()
    assert boat.rudder.commands[-1][1].torque_on
    assert boat.clock.t_s < 3.0


def test_refused_restart_does_not_end_the_loop(boat):
    boat.autopilot.decide(Request(0.0, Arm(armed=True, force=True)))
    assert boat.autopilot.decide(Request(0.0, Restart(shutdown=True))).verdict is Verdict.TEMPORARILY_REJECTED
    run_for(boat, 1.0)
    assert boat.autopilot.restart is None
    assert len(ticks(boat)) > 9


def test_reset_deletes_stored_parameters_and_keeps_the_present_values(boat):
    set_parameter(boat, "CTL_K1", 44.0)
    boat.autopilot.decide(Request(0.0, ForgetParameters()))
    assert boat.store.saved[PARAMETER_FILE] == b""
    assert boat.autopilot.parameters()["CTL_K1"] == 44.0
    set_parameter(boat, "CTL_K2", 0.5)
    boat.autopilot.when_stored(lambda _is_stored: None)
    assert boat.store.saved[PARAMETER_FILE] == b"CTL_K2 0.5\n"


def test_clock_step_changes_no_deadline_and_is_reported(boat):
    utc_values_s = [1000.0]
    boat.clock_setter = ClockSetter(
        lambda: utc_values_s[0], lambda utc_s: utc_values_s.append(utc_s) or True, lambda: False
    )
    boat.position = FakePosition(DeviceRole.POSITION)
    run_for(boat, 2.0)
    set_parameter(boat, "LOOP_LOCK", 0)
    assert utc_values_s[1:] == pytest.approx([2e9], abs=3.0)
    times_s = [tick.t_s for tick in ticks(boat)]
    intervals_s = [later - earlier for earlier, later in itertools.pairwise(times_s)]
    assert intervals_s == pytest.approx([0.1] * len(intervals_s), abs=1e-3)
    clock_texts = [event.text for output in boat.link.outputs for event in output.events if "Clock" in event.text]
    assert clock_texts == [text for text in event_texts(boat) if "Clock" in text]
    assert len(clock_texts) == 1


def test_loop_rate_follows_its_parameter(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.link.publish = lambda _output, now_s: set_parameter(boat, "LOOP_RATE_HZ", 50 if now_s > 0.95 else 10)
    run_for(boat, 2.0)
    times_s = [tick.t_s for tick in ticks(boat)]
    intervals_s = [later - earlier for earlier, later in itertools.pairwise(times_s)]
    assert intervals_s[:10] == pytest.approx([0.1] * 10)
    assert intervals_s[12:] == pytest.approx([0.02] * len(intervals_s[12:]))
    assert len(intervals_s) > 40
    assert ticks(boat)[-1].rate_hz == 50


def test_health_is_an_input_only_when_it_changes(boat):
    run_for(boat, 1.0)
    counts = [len(inputs.devices) for inputs, _, _ in boat.recorder.ticks]
    assert counts[1] == 3
    assert sum(counts) == 3


def test_rudder_is_centred_when_an_error_ends_the_loop(boat):
    def raise_error(output, now_s):
        raise RuntimeError("unexpected")

    boat.link.publish = raise_error
    boat.fault_barrier = FaultBarrier(lambda _line: None)  # it raises an error that is repeated too often
    with pytest.raises(RuntimeError, match="unexpected"):
        run_for(boat, 1.0)
    assert boat.rudder.commands[-1][1].shaft_rad == 0.0
    assert boat.rudder.commands[-1][1].torque_on


def test_rudder_that_passes_the_centre_is_not_yet_safe(boat):
    run_for(boat, 1.0)
    # The rudder is still at 0.2 rad at the first reading; 0.02 rad and more is not centred.
    angles_rad = iter((0.2, 0.019, 0.021, -0.4, -0.021, -0.019, 0.0))
    boat.rudder.commands.clear()
    boat.rudder.command = lambda command, now_s: (
        boat.rudder.commands.append((now_s, command)),
        boat.rudder.samples.append(RudderFeedback(now_s + 0.002, next(angles_rad))),
    )
    make_safe(boat)
    assert len(boat.rudder.commands) == 7
    assert next(angles_rad, None) is None


def test_centred_rudder_ends_the_loop_after_two_readings(boat):
    run_for(boat, 1.0)
    begin_s = boat.clock.t_s
    make_safe(boat)
    assert boat.clock.t_s - begin_s <= 2 * SAFE_INTERVAL_S + 1e-9


def test_stuck_rudder_does_not_prevent_the_end(boat):
    boat.rudder.is_stuck = True
    run_for(boat, 0.2)
    begin_s = boat.clock.t_s
    boat.rudder.commands.clear()
    make_safe(boat)
    assert boat.clock.t_s - begin_s == pytest.approx(2.0)
    times_s = [t_s - begin_s for t_s, _ in boat.rudder.commands]
    assert times_s == pytest.approx([0.1 * number for number in range(20)])


def test_start_problems_are_reported_with_the_first_tick(boat):
    problem = records.Event(records.Severity.WARNING, "mission.plan.0 is damaged: there is no mission")
    boat.notices.append(problem)
    run_for(boat, 1.0)
    reported = [problem in output.events for output in boat.link.outputs]
    assert reported == [problem in output.events for _, output, _ in boat.recorder.ticks]
    assert (reported[0], sum(reported)) == (True, 1)


def test_wind_and_depth_are_read_after_the_command_and_passed_to_the_next_tick(boat):
    parts = {field.name: getattr(boat, field.name) for field in fields(LoopParts) if field.init}
    wind, depth, vessels = (FakeDevice(role) for role in (DeviceRole.WIND, DeviceRole.DEPTH, DeviceRole.AIS))
    order = []
    for device in (wind, depth, vessels):
        device.receive = lambda _now_s, device=device: order.append(device)
    wind.samples = [records.WindSample(0.0, 5.0, 1.0, records.WindReference.APPARENT)]
    depth.samples = [records.DepthSample(0.0, 12.0)]
    loop_parts = LoopParts(**parts | {"wind": wind, "depth": depth, "vessels": vessels})
    run_for(loop_parts, 0.2)
    first, second = (inputs for inputs, _, _ in boat.recorder.ticks)
    assert [sample.wind_m_s for sample in first.wind] == [5.0]
    assert [sample.depth_m for sample in first.depth] == [12.0]
    assert (second.wind, second.depth) == ((), ())
    assert order == [wind, depth, vessels] * 2  # the order of the views of a shared line
    roles = set(loop_parts.health.latest)
    assert {DeviceRole.WIND, DeviceRole.DEPTH, DeviceRole.AIS} <= roles
    assert wind not in loop_parts.devices  # a silent sensor does not keep the process from a restart
