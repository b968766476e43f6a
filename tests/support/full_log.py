"""A log with mission, fence, battery, estimate, a fault and stick input."""

import msgspec

from firmware_py.common.intents import ManualRudder, ReplacePlan, Request
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import (
    Activity,
    Energy,
    Estimate,
    Home,
    Navigation,
    Output,
    Power,
    Water,
)
from firmware_py.faults.fault import Fault
from firmware_py.log.recorder import LogRecorder
from firmware_py.plans.items import Command
from support.link import SNAPSHOT

TICKS, ARM_TICK, BREACH_TICK, STICK_TICK = 600, 100, 300, 400
ESTIMATE = Estimate(0, 1.02, *[0.1] * 14, 1.2)
FENCE = Plan.of(
    PlanKind.FENCE,
    [PlanItem(Command.INCLUDED_VERTEX, 0, params=(3.0, 0, 0, 0), x=x, y=y) for x, y in ((1, 2), (3, 4), (5, 9))]
    + [PlanItem(Command.EXCLUDED_CIRCLE, 0, params=(50.0, 0, 0, 0), x=7, y=8)],
)
MISSION = Plan.of(
    PlanKind.MISSION,
    [PlanItem(Command.WAYPOINT, 3, x=400_000_000, y=-100_000_000), PlanItem(Command.JUMP, 2, params=(0.0, 2.0, 0, 0))],
)
RALLY = Plan.of(PlanKind.RALLY, [PlanItem(Command.RALLY_POINT, 3, x=11, y=12, z=1.0)])


def inputs_of(index, requests=()):
    t_s = 100.0 + 0.1 * index
    return Inputs(
        tick=Tick(index, t_s, 0.001, 0, 10.0),
        headings=(HeadingSample(t_s, 1.0, NorthReference.TRUE, roll_rad=0.1, pitch_rad=0.02),),
        positions=(PositionSample(t_s, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, 1.5, 8, 1.25, 1.7e9 + index),)
        if index % 5 == 0
        else (),
        rudder=(RudderFeedback(t_s, 0.1, 31.0, 12.0, 0.2),),
        requests=requests,
    )


def snapshot_of(index):
    is_armed = index >= ARM_TICK
    return msgspec.structs.replace(
        SNAPSHOT,
        t_s=100.0 + 0.1 * index,
        tick=index,
        armed=is_armed,
        position=PositionSample(100.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, 1.5),
        position_ok=True,
        home=Home(0.7, -0.2001, 1.0),
        bearing_rad=1.2,
        distance_m=40.0,
        faults=1 << Fault.FENCE_BREACHED if BREACH_TICK <= index < BREACH_TICK + 50 else 0,
        estimate=ESTIMATE,
        water=Water(0.4, 0.1, 0.2, -0.1, 0.1),
        navigation=Navigation(Activity.LINE, 0.7, -0.2, 20.0, 1.5, fence_enabled=index >= ARM_TICK),
        servo=RudderFeedback(100.0, 0.1, 31.0, 12.0, 0.2),
        energy=Energy(power_w=1.0, energy_j=10.0),
        power=Power(12.9, -0.5, 0.8, 15.0),
    )


def write_log(directory):
    """Write a log of one minute to a directory; return its path."""
    recorder = LogRecorder(
        directory,
        parameters=ParameterSet(),
        plans=Plans(fence=FENCE, rally=RALLY),
        file_bytes=1 << 24,
        max_total_bytes=1 << 30,
        utc_s=1.7e9,
        software="rambler 1.2.3.dev0 (git 0123abcd-dirty)",
        background=False,
    )
    requests = {
        5: (Request(100.5, ReplacePlan(MISSION)),),
        STICK_TICK: (Request(100.0 + 0.1 * STICK_TICK, ManualRudder(0.5)),),
    }
    for index in range(TICKS):
        output = Output(RudderCommand(0.25, torque_on=True), snapshot_of(index))
        recorder.offer(inputs_of(index, requests.get(index, ())), output, lambda: "{}")
    recorder.close()
    return directory / "00000001.BIN"
