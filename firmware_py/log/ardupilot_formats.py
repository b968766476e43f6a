"""Message formats of ArduPilot's log tools, with ArduPilot's names, columns and units.

Source: ArduPilot libraries/AP_Logger/LogStructure.h and the structures of its libraries and of its rovers.
Columns without a source on this boat are left out.
"""

from __future__ import annotations

from typing import Final

from firmware_py.log.dataflash import MessageType

CHANNELS: Final = 12


def _row(number: int, name: str, labels: str, values: str, units: str) -> MessageType:
    """Describe a message whose columns after TimeUS are in unscaled units."""
    multipliers = "".join("-" if unit in "-#" else "G" if unit in "DU" else "0" for unit in units)
    return MessageType(number, name, f"TimeUS,{labels}", f"Q{values}", f"s{units}", f"F{multipliers}")


_LABELS: Final = ",".join(f"C{number}" for number in range(1, CHANNELS + 1))

ATTITUDE: Final = _row(183, "ATT", "DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "ffffffB", "ddddhh-")
PLACE: Final = _row(184, "POS", "Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "LLfff", "DUmmm")
ESTIMATE: Final = _row(166, "XKF1", "C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,OH", "Bfffffffffff", "#ddhnnnnmmmm")
OUTPUTS: Final = _row(167, "RCOU", _LABELS, "H" * CHANNELS, "Y" * CHANNELS)
STEERING: Final = _row(168, "STER", "Demanded,Achieved,LatAcc,TurnRate", "ffff", "ddok")
CONTROL: Final = _row(186, "CTUN", "NavRoll,Roll,NavPitch,Pitch,ThO,RdO,As,E2T", "ffffffff", "dddd-dn-")
RATES: Final = _row(187, "RATE", "Y,ROut,POut,YOut,AOut", "fffff", "k----")
TESTS: Final = _row(188, "XKF4", "C,SV,SP,SH,SM,SVT,SS,GPS,PI", "BfffffIHb", "#--------")
ATTITUDE_B: Final = _row(189, "AHR2", "Roll,Pitch,Yaw,Alt,Lat,Lng", "ffffLL", "ddhmDU")
WATER: Final = _row(190, "ARSP", "I,Airspeed", "Bf", "#n")
RECEIVER: Final = _row(191, "GPA", "I,Delta", "BI", "#-")
LINE: Final = _row(169, "NTUN", "WpDist,WpBrg,DesYaw,Yaw,XTrack", "fffff", "mhhhm")
INPUTS: Final = _row(185, "RCIN", _LABELS, "H" * CHANNELS, "Y" * CHANNELS)
BATTERY: Final = _row(172, "BAT", "Inst,Volt,VoltR,Curr,CurrTot,Temp,RemPct", "Bffffff", "#vvAiO%")
THROTTLE: Final = _row(173, "THR", "ThrIn,ThrOut,DesSpeed,Speed", "ffff", "%%nn")
PERFORMANCE: Final = _row(174, "PM", "NLon,NLoop,MaxT,LogDrop", "HHII", "--Y-")
ARMING: Final = _row(175, "ARM", "ArmState,ArmChecks,Forced,Method", "BIBB", "----")
EVENT: Final = _row(176, "EV", "Id", "B", "-")
ERROR: Final = _row(177, "ERR", "Subsys,ECode", "BB", "--")
STATE: Final = _row(178, "STAT", "isFlying,isFlyProb,Armed,Safety", "BfBB", "----")
VERSION: Final = _row(179, "VER", "BT,Maj,Min,Pat,FWT,GH,FWS,BU", "BBBBBIZB", "--------")
ITEM: Final = MessageType(
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
    *(ATTITUDE, PLACE, ESTIMATE, OUTPUTS, STEERING, LINE, INPUTS, BATTERY, THROTTLE, PERFORMANCE),
    *(CONTROL, RATES, TESTS, ATTITUDE_B, WATER, RECEIVER),
    *(ARMING, EVENT, ERROR, STATE, VERSION, ITEM, FENCE, RALLY),
)
