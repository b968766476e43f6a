"""Formats of ArduPilot messages for log viewers, with ArduPilot's names, columns and units.

Source: ArduPilot libraries/AP_Logger/LogStructure.h and the structures of its libraries and of its rovers.
Columns that this boat cannot fill are omitted.
"""

from __future__ import annotations

from typing import Final

from firmware_py.log.dataflash import MessageType

CHANNELS: Final = 12


def _message_type(number: int, name: str, labels: str, values: str, units: str) -> MessageType:
    """Return a message type with TimeUS and columns in unscaled units (latitude and longitude: 1e-7 deg)."""
    multipliers = "".join("-" if unit in "-#" else "G" if unit in "DU" else "0" for unit in units)
    return MessageType(number, name, f"TimeUS,{labels}", f"Q{values}", f"s{units}", f"F{multipliers}")


_CHANNEL_LABELS: Final = ",".join(f"C{number}" for number in range(1, CHANNELS + 1))

ATTITUDE: Final = _message_type(183, "ATT", "DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "ffffffB", "ddddhh-")
POSITION: Final = _message_type(184, "POS", "Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "LLfff", "DUmmm")
ESTIMATE: Final = _message_type(
    166, "XKF1", "C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,OH", "Bfffffffffff", "#ddhnnnnmmmm"
)
OUTPUTS: Final = _message_type(167, "RCOU", _CHANNEL_LABELS, "H" * CHANNELS, "Y" * CHANNELS)
STEERING: Final = _message_type(168, "STER", "Demanded,Achieved,LatAcc,TurnRate", "ffff", "ddok")
CONTROL: Final = _message_type(186, "CTUN", "NavRoll,Roll,NavPitch,Pitch,ThO,RdO,As,E2T", "ffffffff", "dddd-dn-")
RATES: Final = _message_type(187, "RATE", "Y,ROut,POut,YOut,AOut", "fffff", "k----")
INNOVATION_TESTS: Final = _message_type(188, "XKF4", "C,SV,SP,SH,SM,SVT,SS,GPS,PI", "BfffffIHb", "#--------")
COMPASS_ATTITUDE: Final = _message_type(189, "AHR2", "Roll,Pitch,Yaw,Alt,Lat,Lng", "ffffLL", "ddhmDU")
WATER_SPEED: Final = _message_type(190, "ARSP", "I,Airspeed", "Bf", "#n")
RECEIVER: Final = _message_type(191, "GPA", "I,Delta", "BI", "#-")
NAVIGATION: Final = _message_type(169, "NTUN", "WpDist,WpBrg,DesYaw,Yaw,XTrack", "fffff", "mhhhm")
INPUTS: Final = _message_type(185, "RCIN", _CHANNEL_LABELS, "H" * CHANNELS, "Y" * CHANNELS)
BATTERY: Final = _message_type(172, "BAT", "Inst,Volt,VoltR,Curr,CurrTot,Temp,RemPct", "Bffffff", "#vvAiO%")
THROTTLE: Final = _message_type(173, "THR", "ThrIn,ThrOut,DesSpeed,Speed", "ffff", "%%nn")
PERFORMANCE: Final = _message_type(174, "PM", "NLon,NLoop,MaxT,LogDrop", "HHII", "--Y-")
ARMING: Final = _message_type(175, "ARM", "ArmState,ArmChecks,Forced,Method", "BIBB", "----")
EVENT: Final = _message_type(176, "EV", "Id", "B", "-")
ERROR: Final = _message_type(177, "ERR", "Subsys,ECode", "BB", "--")
STATE: Final = _message_type(178, "STAT", "isFlying,isFlyProb,Armed,Safety", "BfBB", "----")
VERSION: Final = _message_type(179, "VER", "BT,Maj,Min,Pat,FWT,GH,FWS,BU", "BBBBBIZB", "--------")
MISSION_ITEM: Final = MessageType(
    180,
    "CMD",
    "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame",
    "QHHHffffLLfB",
    "s-------DUm-",
    "F-------GG0-",
)
FENCE: Final = MessageType(181, "FNCE", "TimeUS,Tot,Seq,Type,Lat,Lng,Count,Radius", "QHHBLLHf", "s---DU-m", "F---GG-0")
RALLY: Final = MessageType(182, "RALY", "TimeUS,Tot,Seq,Lat,Lng,Alt,Flags", "QHHLLfB", "s--DUm-", "F--GG0-")

TYPES: Final = (
    *(ATTITUDE, POSITION, ESTIMATE, OUTPUTS, STEERING, NAVIGATION, INPUTS, BATTERY, THROTTLE, PERFORMANCE),
    *(CONTROL, RATES, INNOVATION_TESTS, COMPASS_ATTITUDE, WATER_SPEED, RECEIVER),
    *(ARMING, EVENT, ERROR, STATE, VERSION, MISSION_ITEM, FENCE, RALLY),
)
