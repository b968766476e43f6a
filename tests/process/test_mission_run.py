"""Missions with the real autopilot on ptys: completed, and resumed after a kill."""

from itertools import groupby

import numpy as np
import pytest

from firmware_py.cli.export.messages import read_messages
from firmware_py.common.plan import PlanKind
from firmware_py.log.ardupilot_state import FENCE_OFF, FENCE_ON
from firmware_py.log.disk import log_files
from firmware_py.plans.items import Command
from hil.ship import scenarios
from hil.sim.truth import read
from support.harness import is_replay_identical, rambler_hil
from support.paths import REPLAY
from support.plans import FENCE_ITEMS, item, mission_file, save_plans

AUTO = 10


@pytest.mark.proof
def test_mission_resumes_after_a_kill(make_boat):
    boat = make_boat(
        scenario=scenarios.Scenario("stream", "", 1.0, 6.0, 3.0, 2.0, 0.0, 0.2, 120.0),
        settings={"BOOT_RESUME": 2, "LOIT_RADIUS": 40.0, "WP_RADIUS": 15.0},
        goals="",
        mode=AUTO,
        plans=[
            mission_file(
                item(Command.WAYPOINT, 60, 0), item(Command.WAYPOINT, 60, 90), item(Command.LOITER_UNLIMITED, 0, 90)
            )
        ],
    )
    boat.start().run(108.0)
    boat.kill()
    assert "Mission: item 2" in boat.output_text()
    assert "Mission: item 3" not in boat.output_text()
    boat.start().run(112.0)
    boat.finish()
    assert "Resumed AUTO" in boat.output_text()
    assert "Mission: item 1" not in boat.output_text()
    assert "Mission: item 3" in boat.output_text()
    # The boat stays on the leg, without a new line from the position of the kill.
    track_after_kill = boat.track(123.0)
    on_leg = track_after_kill[: np.argmax(track_after_kill[:, 2] > 70.0)]
    assert len(on_leg) > 20
    assert np.abs(on_leg[:, 1] - 60.0).max() < 15.0
    final_track = boat.track(215.0)
    assert np.hypot(final_track[:, 1], final_track[:, 2] - 90.0).max() < 60.0


@pytest.mark.proof
def test_autopilot_steers_at_once_after_a_kill_on_a_mission(make_boat):
    boat = make_boat(
        settings={"BOOT_RESUME": 2, "WP_RADIUS": 5.0},
        goals="",
        scenario="swell",
        second_compass=True,
        without=("link",),
    )
    for path in (REPLAY / "state").iterdir():
        (boat.state / path.name).write_bytes(path.read_bytes())
    boat.start().run(2.0)
    assert abs(boat.command_deg()) > 5.0  # the item is abeam
    boat.run(118.0)
    boat.finish()
    output = [line.split(maxsplit=2)[2] for line in boat.output_text().splitlines() if line.startswith("  ")]
    assert output[:2] == ["Mode AUTO", "Resumed AUTO, 0 s old"]
    assert not [text for text in output if text.startswith("Mission")], output  # no item starts again
    track = boat.track(0.0)
    distance_m = np.hypot(track[:, 1], track[:, 2] - 40.0)
    assert distance_m[0] == pytest.approx(40.0, abs=1.0)
    assert distance_m.min() < 20.0  # turning circle; the boat keeps station there


EVERY_KIND = [
    item(Command.WAYPOINT, 200, 0),
    item(Command.CHANGE_SPEED, None, None, 0, 0.5),
    item(Command.WAYPOINT, 200, 150, 60),
    item(Command.YAW, None, None, 90, 0, 1, 1),
    item(Command.DELAY, None, None, 120),
    item(Command.YAW_SPEED, None, None, 90, 0, 1),
    item(Command.LOITER_TURNS, 100, 250, 2, 0, 50),
    item(Command.LOITER_TIME, 0, 150, 120, 0, 60),
    item(Command.SET_HOME, 20, 20, 0),
    item(Command.WAYPOINT, 0, 60),
    item(Command.JUMP, None, None, 9, 1),
    item(Command.JUMP_TAG, None, None, 7),
    item(Command.FENCE_ENABLE, None, None, 0),
    item(Command.CONDITION_DISTANCE, None, None, 50),
    item(Command.WAYPOINT, 0, -20),
    item(Command.CONDITION_DELAY, None, None, 20),
    item(Command.JUMP_TO_TAG, None, None, 7, 1),
    item(Command.RETURN),
    item(Command.LOITER_UNLIMITED, 0, 0),
]


@pytest.mark.proof
def test_mission_with_every_kind_of_item_is_completed(tmp_path):
    plans = {PlanKind.MISSION: EVERY_KIND, PlanKind.FENCE: FENCE_ITEMS[:4]}
    words = ["run", "mission", "--mode", "auto", "--state", save_plans(tmp_path / "memory", plans)]
    words += ["--set", "LOIT_RADIUS=60", "FENCE_ENABLE=1"]
    code, _, errors = rambler_hil(*words, "--seconds", "4000", "--speed", "max", "--out", tmp_path / "out")
    assert (code, errors) == (0, "")
    output = (tmp_path / "out" / "firmware.log").read_text()
    for number in (1, 3, 4, 5, 6, 7, 8, 10, 14, 15, 16, 18, 19):
        assert f"Mission: item {number}\n" in output
    assert output.count("Mission: item 16\n") == 2
    assert fence_events(tmp_path / "out") == [FENCE_ON, FENCE_OFF]
    truth = read(tmp_path / "out" / "truth.csv")
    is_last = truth.time_s > truth.time_s[-1] - 600.0
    assert np.mean(np.hypot(truth.north_m[is_last], truth.east_m[is_last]) < 65.0) > 0.95
    assert is_replay_identical(tmp_path / "out")


def fence_events(out):
    """Return the fence events of the log in order: enabled and disabled."""
    logs = [path for _, path in sorted(log_files(out / "state" / "logs").items())]
    events = [row.values["Id"] for path in logs for row in read_messages(path.read_bytes(), {"EV"})]
    return [event for event, _ in groupby(events) if event in {FENCE_ON, FENCE_OFF}]
