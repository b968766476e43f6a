"""What the bench plays: the compass whose headings count, and the watch on goal frames."""

import pytest

from hil.bench.rig import CountingCompass, GoalWatch
from hil.devices.crc import crc16_8005
from hil.devices.nmea_text import whole_sentence


def frame(body, device_id=1):
    head = b"\xff\xff\xfd\x00" + bytes([device_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16_8005(head).to_bytes(2, "little")


def goal(address, data):
    return frame(bytes([0x83, address, 0, len(data), 0, 1]) + data, device_id=0xFE)


GOAL = goal(116, (2048).to_bytes(4, "little"))
OTHERS = (
    frame(bytes([0x02, 116, 0, 4, 0])),  # reads the goal
    goal(112, (100).to_bytes(4, "little")),  # writes another register
    goal(116, b"\x00\x08"),  # half a goal
    GOAL[:-1] + bytes([GOAL[-1] ^ 1]),  # damaged
)


def test_headings_are_distinct():
    compass = CountingCompass()
    output = []
    for _ in range(3):
        due_s = compass.next_output_s()
        assert compass.take_output(due_s - 0.001) == b""
        output.append(compass.take_output(due_s))
    assert output == [whole_sentence(f"HEHDT,{text},T") for text in ("0.001", "0.002", "0.003")]
    assert compass.next_output_s() == pytest.approx(0.3, rel=1e-4)


def test_late_caller():
    compass = CountingCompass()
    assert compass.take_output(0.55) == whole_sentence("HEHDT,0.001,T")
    assert compass.next_output_s() == pytest.approx(0.6, rel=1e-4)


def test_goal_frame_time():
    watch = GoalWatch()
    watch.receive(1.0, GOAL[:5])
    assert watch.times_s == []
    watch.receive(1.001, GOAL[5:])
    assert watch.times_s == [1.001]


@pytest.mark.parametrize("data", OTHERS)
def test_other_frames(data):
    watch = GoalWatch()
    watch.receive(1.0, data)
    assert watch.times_s == []
    watch.receive(2.0, GOAL)
    assert watch.times_s == [2.0]
