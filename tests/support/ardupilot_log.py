"""DataFlash logs of ArduPilot Rover: type, struct, format characters and labels of its LogStructure.h."""

import struct

import numpy as np

MESSAGES = {
    "PARM": (64, "<Q16sff", "QNff", "TimeUS,Name,Value,Default"),
    "ATT": (65, "<QhhhhHHHHB", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "STER": (66, "<Qhfffff", "Qhfffff", "TimeUS,SteerIn,SteerOut,DesLatAcc,LatAcc,DesTurnRate,TurnRate"),
    "RCOU": (67, "<QHHHH", "QHHHH", "TimeUS,C1,C2,C3,C4"),
    "GPS": (68, "<QBBiiff", "QBBLLff", "TimeUS,I,Status,Lat,Lng,Spd,GCrs"),
}
SERVO = (("SERVO2_FUNCTION", 26), ("SERVO2_MIN", 1100), ("SERVO2_MAX", 1900), ("SERVO2_REVERSED", 1))
BEGIN_US = 5_000_000


def record(name, *values):
    number, layout, _, _ = MESSAGES[name]
    return b"\xa3\x95" + bytes((number,)) + struct.pack(layout, *values)


def log_bytes(time_s, rudder_rad, heading_rad, yaw_rate_rad_s, *, pulses, fixes=None):
    """Return a log. `pulses`: with the servo parameters. Rows of `fixes`: latitude, longitude, course [deg], speed."""
    messages = []
    for name, (number, layout, characters, labels) in MESSAGES.items():
        length = 3 + struct.calcsize(layout)
        text = struct.pack("<BB4s16s64s", number, length, name.encode(), characters.encode(), labels.encode())
        messages.append(b"\xa3\x95\x80" + text)
    messages += [record("PARM", 0, name.encode(), value, 0.0) for name, value in SERVO if pulses]
    fixes = np.tile((0.0, 0.0, 0.0, 0.4), (len(time_s), 1)) if fixes is None else fixes
    for seconds, rudder, heading, rate, fix in zip(time_s, rudder_rad, heading_rad, yaw_rate_rad_s, fixes, strict=True):
        time_us, rudder_deg = round(seconds * 1e6) + BEGIN_US, np.degrees(rudder)
        latitude, longitude, course, speed = fix
        place = (round(latitude * 1e7), round(longitude * 1e7))
        messages.append(record("STER", time_us, 0, rudder_deg * 100.0, 0.0, 0.0, 0.0, np.degrees(rate)))
        messages.append(record("RCOU", time_us, 1500, round(1500 - 400 * rudder_deg / 45.0), 1500, 1500))
        messages.append(
            record("ATT", time_us, 0, 0, 0, 0, 0, round(np.degrees(heading) % 360.0 * 100.0) % 36000, 0, 0, 3)
        )
        messages.append(record("GPS", time_us, 0, 3, *place, speed, course))
        messages.append(record("GPS", time_us, 1, 3, *place, 9.0, course))
    return b"".join(messages)
