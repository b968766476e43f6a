"""Emulators neither raise nor stop replying after arbitrary bytes at arbitrary times."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.sensors.mavlink_frames import Encoder, Message
from hil.devices.bno08x_rvc import Bno08xRvcEmulator
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.feetech import FeetechEmulator
from hil.devices.hobby_servo import HobbyServo
from hil.devices.impairment import Impaired
from hil.devices.maestro import MaestroEmulator
from hil.devices.mavlink_board import MavlinkBoardEmulator
from hil.devices.mti import MtiEmulator
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.rion import RionEmulator
from hil.devices.volz import VolzEmulator
from hil.devices.witmotion import WitmotionEmulator
from hil.ship.servo import ServoShaft


class StillBoat:
    def heading_rad(self):
        return 1.0

    def yaw_rate_rad_s(self):
        return 0.0


def rng():
    return np.random.default_rng(1)


DYNAMIXEL_PING = bytes.fromhex("FFFFFD0001030001194E")
PNI_MOD_INFO = bytes.fromhex("000501EFD4")
MTI_GOTO_CONFIG = bytes.fromhex("FAFF3000D1")
RION_ASK = bytes.fromhex("6804000408")
WITMOTION_READ = bytes.fromhex("FFAA270300")
VOLZ_CURRENT = bytes.fromhex("B0010000C006")
FEETECH_PING = bytes.fromhex("FFFF010201FB")
MAVLINK_INTERVAL = Encoder(191).message_interval(1, 1, Message.ATTITUDE, 10)
MAESTRO_ERRORS = b"\xa1\xa1"

# Device -> emulator, request, and the start of its reply.
DEVICES = {
    "dynamixel": (lambda: DynamixelEmulator(ServoShaft(), rng()), DYNAMIXEL_PING, b"\xff\xff\xfd\x00\x01\x07\x00\x55"),
    "pni": (lambda: PniTcmEmulator(StillBoat(), rng()), PNI_MOD_INFO, b"\x00\x0d\x02TCM5"),
    "mti": (lambda: MtiEmulator(StillBoat(), rng()), MTI_GOTO_CONFIG, b"\xfa\xff\x31\x00\xd0"),
    "rion": (lambda: RionEmulator(StillBoat(), rng()), RION_ASK, b"\x68\x0d\x00\x84"),
    "witmotion": (lambda: WitmotionEmulator(StillBoat(), rng(), baud=115200), WITMOTION_READ, b"\x55\x5f"),
    "mavlink": (
        lambda: MavlinkBoardEmulator(StillBoat(), rng()),
        MAVLINK_INTERVAL,
        b"\x4d\x00\x00\xff\x01",  # COMMAND_ACK of command 511
    ),
    "volz": (lambda: VolzEmulator(ServoShaft(), rng()), VOLZ_CURRENT, b"\x30\x01"),
    "feetech": (lambda: FeetechEmulator(ServoShaft(), rng()), FEETECH_PING, b"\xff\xff\x01\x02\x00\xfc"),
    # The second reading of the errors has none.
    "maestro": (lambda: MaestroEmulator(HobbyServo(ServoShaft())), MAESTRO_ERRORS, b"\0\0"),
}
# Noise with parts of real frames, which reach more states of the parsers than random bytes alone.
PIECES = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([
        DYNAMIXEL_PING, PNI_MOD_INFO, VOLZ_CURRENT, b"\xff\xff\xfd\x00", b"\xff\xff\xfd\x00\x01\xff\xff",
        b"\x01\x0e\x06", b"\x00\x05", bytes.fromhex("000515BD61"), bytes.fromhex("000A030405181908DACC"),
        bytes.fromhex("000F180000000000003DCCCCCDF971"), b"\xff\xff\xfd\x00\xfe\x09\x00\x83",
        MAVLINK_INTERVAL, MAVLINK_INTERVAL[:20],
        MTI_GOTO_CONFIG, bytes.fromhex("FAFF1000F1"), bytes.fromhex("FAFFC00041"), b"\xfa\xff\xc0\x80",
        FEETECH_PING, b"\xff\xff\x01\xff", bytes.fromhex("FFFF01070328010055096D"),
        bytes.fromhex("FFFF01040228FFD1"), bytes.fromhex("FFFF01040228FAD6"), bytes.fromhex("FFFFFE0205FA"),
        bytes.fromhex("8400702E"), b"\x90\x00", b"\x87\x00\x05\x00", b"\x84\x00\x01", b"\xaa\x0c\x21", b"\xaa\x0c",
        bytes.fromhex("FAFFC00420340005E4"), bytes.fromhex("FAFFC004E020FFFF3F"), bytes.fromhex("FAFF3F00C2"),
        RION_ASK, bytes.fromhex("6805000C0112"), b"\x68\x10", bytes.fromhex("FFAA6988B5FFAA030500"), b"\xff\xaa\x27",
    ]),
)  # fmt: skip
STREAM = st.lists(st.tuples(PIECES, st.floats(0.0, 0.05)), max_size=30)


@pytest.mark.parametrize("name", DEVICES)
@given(stream=STREAM)
def test_emulators_reply_after_arbitrary_bytes(name, stream):
    make, request, reply_start = DEVICES[name]
    emulator = make()
    now_s = 0.0
    for data, pause_s in stream:
        now_s += pause_s
        emulator.receive(now_s, data)
        emulator.take_output(now_s)
    now_s += 5.0
    emulator.take_output(now_s)
    emulator.receive(now_s, request)
    replies = emulator.take_output(now_s + 0.05)
    assert reply_start in replies


@pytest.mark.parametrize("name", DEVICES)
@given(stream=STREAM)
def test_next_output_time_always_advances(name, stream):
    """A caller that reads the output at each due time never loops at one time."""
    emulator = DEVICES[name][0]()
    now_s = 0.0
    for data, pause_s in stream:
        now_s += pause_s
        emulator.receive(now_s, data)
        outputs = 0
        while emulator.next_output_s() <= now_s:
            emulator.take_output(now_s)
            outputs += 1
            assert outputs < 100
        assert math.isinf(emulator.next_output_s()) or emulator.next_output_s() > now_s


@pytest.mark.parametrize("name", DEVICES)
@given(stream=STREAM, seed=st.integers(0, 2**32 - 1))
def test_output_is_repeatable_for_the_same_input_and_seed(name, stream, seed):
    runs = []
    for _ in range(2):
        emulator = Impaired(
            DEVICES[name][0](), np.random.default_rng(seed), drop=0.05, flip=0.05, duplicate=0.05, garbage=0.2
        )
        now_s, output = 0.0, []
        for data, pause_s in stream:
            now_s += pause_s
            emulator.receive(now_s, data)
            output.append(emulator.take_output(now_s))
        runs.append(output)
    assert runs[0] == runs[1]


@given(
    rate_hz=st.floats(0.5, 50.0),
    phase_s=st.floats(0.0, 1.0),
    baud=st.sampled_from([4800, 9600, 38_400]),
    gaps=st.lists(st.floats(0.0, 3.0), min_size=1, max_size=30),
)
def test_nmea_compass_outputs_only_complete_sentences(rate_hz, phase_s, baud, gaps):
    compass = NmeaCompassEmulator(StillBoat(), rng(), rate_hz=rate_hz, phase_s=phase_s, baud=baud, rot=True)
    now_s, output = 0.0, b""
    for gap_s in gaps:
        now_s += gap_s
        output += compass.take_output(now_s)
    assert output == b"" or output.endswith(b"\r\n")
    assert all(line.startswith(b"$HC") for line in output.splitlines())


@given(gaps=st.lists(st.floats(0.0, 0.5), min_size=1, max_size=30), off_s=st.none() | st.floats(0.0, 1.0))
def test_bno08x_outputs_only_complete_frames(gaps, off_s):
    gyro, now_s, output = Bno08xRvcEmulator(StillBoat(), rng()), 0.0, b""
    for gap_s in gaps:
        now_s += gap_s
        gyro.receive(now_s, b"\xaa\xaa")
        if off_s is not None and now_s > 1.0:
            gyro.power_cycle(now_s, off_s)
            off_s = None
        output += gyro.take_output(now_s)
    frames = [output[start : start + 19] for start in range(0, len(output), 19)]
    assert all(frame[:2] == b"\xaa\xaa" and sum(frame[2:18]) % 256 == frame[18] for frame in frames)
