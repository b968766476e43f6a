"""The counting compass and the recorder of goal frames."""

import pytest

from hil.bench.rig import CountingCompass, GoalRecorder
from hil.devices.crc import crc16_8005
from hil.devices.nmea_text import whole_sentence


def frame(body, device_id=1):
    data = b"\xff\xff\xfd\x00" + bytes([device_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return data + crc16_8005(data).to_bytes(2, "little")


def goal(address, data):
    return frame(bytes([0x83, address, 0, len(data), 0, 1]) + data, device_id=0xFE)


GOAL = goal(116, (2048).to_bytes(4, "little"))
OTHER_FRAMES = (
    frame(bytes([0x02, 116, 0, 4, 0])),  # reads the goal
    goal(112, (100).to_bytes(4, "little")),  # writes another register
    goal(116, b"\x00\x08"),  # half of the goal
    GOAL[:-1] + bytes([GOAL[-1] ^ 1]),  # damaged
)


def test_each_heading_is_one_thousandth_larger():
    compass = CountingCompass()
    output = []
    for _ in range(3):
        due_s = compass.next_output_s()
        assert compass.take_output(due_s - 0.001) == b""
        output.append(compass.take_output(due_s))
    assert output == [whole_sentence(f"HEHDT,{text},T") for text in ("0.001", "0.002", "0.003")]
    assert compass.next_output_s() == pytest.approx(0.3, rel=1e-4)


def test_late_caller_gets_the_last_sentence():
    compass = CountingCompass()
    assert compass.take_output(0.55) == whole_sentence("HEHDT,0.001,T")
    assert compass.next_output_s() == pytest.approx(0.6, rel=1e-4)


def test_complete_goal_frame_is_recorded():
    recorder = GoalRecorder()
    recorder.receive(1.0, GOAL[:5])
    assert recorder.times_s == []
    recorder.receive(1.001, GOAL[5:])
    assert recorder.times_s == [1.001]


@pytest.mark.parametrize("data", OTHER_FRAMES)
def test_other_frame_is_not_recorded(data):
    recorder = GoalRecorder()
    recorder.receive(1.0, data)
    assert recorder.times_s == []
    recorder.receive(2.0, GOAL)
    assert recorder.times_s == [2.0]
