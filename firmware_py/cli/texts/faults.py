"""What to do about each fault; what it means is its condition in the table of faults."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.faults.fault import Fault

REMEDIES: Mapping[Fault, str] = {
    Fault.COMPASS_LOST: "power and cable of the compass; a second compass, or a receiver with course, keeps her going",
    Fault.POSITION_LOST: "antenna and its view of the sky; water in the plug; she goes on by reckoning meanwhile",
    Fault.RUDDER_SILENT: "power and cable of the servo, its id and baud; MANUAL or a safe mode does not help",
    Fault.RUDDER_ERROR: "`rambler status` shows what it says; let it cool, free it, switch it off and on",
    Fault.LOOP_LATE: "something else uses the computer; take it away, or install her as the service (real time)",
    Fault.STORAGE_FAILING: "the disk fails, is read-only or out of inodes (`df -i`); no log meanwhile: fetch the logs",
    Fault.STORAGE_FULL: "her own old logs make room by themselves: something else fills the disk; fetch and erase",
    Fault.CURRENT_STRONG: "wait for the tide, or send her where the current is weaker",
    Fault.MISSION_UNUSABLE: "send a mission, or mend its DO_JUMP items",
    Fault.FENCE_BREACHED: "bring her back, or mend the fence; `FENCE_ENABLE` 0 takes it away",
    Fault.COMPASS_SILENT: "power and cable of the compass named; she steers by the next source meanwhile",
    Fault.COMPASS_FROZEN: "switch the compass off and on; a cold or simulated one may stand still: `CMP_FROZEN_S`",
    Fault.COMPASS_JUMPING: "something magnetic moves near it, or its cable is bad; look at it in the log",
    Fault.COMPASS_DISAGREES: "calibrate both (deviation, mounting); which one is right the course over ground tells",
    Fault.POSITION_JUMPING: "spoofing, reflections or a bad antenna; if she was carried, it goes by itself",
    Fault.RUDDER_ASTRAY: "`RUD_REVERSE`, the horn's screw, growth on the blade",
    Fault.RUDDER_JAMMED: "a line or weed in the rudder; HOLD and MANUAL to and fro may free it",
    Fault.RUDDER_HOT: "let it rest (HOLD); it works too hard: friction, or `CTL_PRICE` too low",
    Fault.RUDDER_OVERLOADED: "something holds the rudder; as for a jam",
    Fault.RUDDER_REPOWERED: "the servo's supply broke down: plug, fuse, cable too thin",
    Fault.SUPPLY_LOW: "battery or cable; quieter links and `PWR_...` save",
    Fault.CLOCK_STEPPED: "nothing; log times jump here",
    Fault.STATION_SILENT: "look at your link; what she does meanwhile is `FS_GCS_ACT`",
    Fault.STEERING_LOST: "blade lost, or she lies becalmed or in weed; with no rudder, fetch her",
    Fault.KEY_LOST: "set or remove the key over a trusted link, or by `rambler key`",
    Fault.HELM_OSCILLATES: "she mends it herself; if it stays, identify her anew or raise `CTL_PRICE`",
    Fault.BATTERY_LOW: "see the energy report (`rambler energy`); lighten the load",
    Fault.BATTERY_CRITICAL: "sun and time; arming waits until it is charged",
    Fault.POWER_SILENT: "cable of the charger or monitor; what it said is not known meanwhile",
    Fault.VESSEL_NEAR: "see the vessel told just before; call it, or let her step aside (`AIS_ACT`)",
    Fault.ESTIMATE_INCONSISTENT: "check `MDL_K` and `MDL_T_S` (`rambler-hil identify`), compass and rudder feedback",
    Fault.STEERING_REVERSED: "disarm, change `RUD_REVERSE`, arm again; was the servo or the compass turned round?",
}
