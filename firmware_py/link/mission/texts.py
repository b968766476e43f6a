"""The STATUSTEXTs of plans, files and logs: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_MEND = "mend the item named, send the plan again; the old plan stands"
_AGAIN = "send it again; the old one stands"
_BROKEN = "the file is cut off, or not of this kind"

TEXTS: Mapping[str, tuple[str, str]] = {
    "New <plan>: <number> items": ("a plan is in force and on disk", "nothing"),
    "New <plan>: items <number> to <number>": ("a mission is in force and on disk; home is item 0", "nothing"),
    "<item> is <number> m outside the fence": (
        "where the fence is enabled, the mission ends there in what `FS_FENCE_ACT` says",
        "move the item or the fence; `rambler plan check` names each item",
    ),
    "Leg to <item> leaves the fence by <number> m": (
        "both ends lie inside, the straight way between them does not",
        "add a waypoint, or move the fence",
    ),
    "<item outside the fence>, and <number> more": ("the same of several items", "`rambler plan check` names each"),
    "First waypoint is taken as home and skipped": (
        "the program does not know that an ArduPilot's mission begins with home, as MAVSDK's `Mission` does not",
        "send home, or anything with an absolute altitude, as item 0; with MAVSDK use `MissionRaw`",
    ),
    "<plan> cleared": ("it is gone, from the disk too", "nothing"),
    "<plan> not cleared: <why>": ("it stands as it was", "see what is named; clear it again"),
    "<plan> rejected: <why>": ("the plan was refused as a whole; why is a row of this page", _MEND),
    "it was refused": ("the plan was not taken", _AGAIN),
    "Mission item <number> refused": ("the mission continues with the present item", "name an existing item"),
    "plan not stored; the old one stays active": ("the disk did not take it", "see STORAGE_FAILING"),
    "the plan has been changed meanwhile": (
        "another station has changed it during the upload",
        "read the plan, then send it again",
    ),
    "no such items to overwrite": ("a part of a plan was sent for items that there are not", _AGAIN),
    "station silent at item <number>": ("an upload has not gone on for seconds", _AGAIN),
    "replaced by system <number>": ("another station uploads now", "wait for it, then send again"),
    "system <number> is uploading": ("another station uploads now", "wait for it, then send again"),
    "<number> items; at most <number> are supported": ("the plan is too long", "shorten it; DO_JUMP repeats a part"),
    "<command> is not known in a <plan> plan": ("the item is not supported; see plan items", _MEND),
    "<item>: frame <number> is not supported": ("places are latitude and longitude", _MEND),
    "<item>: param<number> is infinite": ("a broken number", _MEND),
    "<item>: param<number> is <value>; allowed: <values>": ("the value is not allowed", _MEND),
    "<item>: 0, 0 is not a valid place": ("stations send this where none was set", _MEND),
    "<item>: the latitude is out of range": ("beyond 90 deg, or no number", _MEND),
    "<item>: the longitude is out of range": ("beyond 180 deg, or no number", _MEND),
    "<item>: the altitude is infinite": ("a broken number", _MEND),
    "<item>: the altitude is not a number": ("a broken number", _MEND),
    "<item>: a time must be -1, or 0 or more": ("-1 means any", _MEND),
    "<item>: a time of day needs an hour": ("minutes and seconds alone are none", _MEND),
    "DO_JUMP: param1 is home, which is no item to go on with": ("it leads to item 0", _MEND),
    "DO_JUMP: the target item does not exist": ("it leads nowhere", _MEND),
    "DO_JUMP_TAG: no JUMP_TAG with this tag": ("it leads nowhere", _MEND),
    "CONDITION_DISTANCE: no item with a place follows": (
        "before the next jump or item without a place there is no waypoint whose distance could count",
        _MEND,
    ),
    "<item>: endless loop without an item that takes time": ("the mission would never continue", _MEND),
    "a second fence return point": ("there is one at most", _MEND),
    "the polygon crosses itself": ("inside and outside are not plain", _MEND),
    "the polygon has fewer than 3 different vertices": ("it has no inside", _MEND),
    "the polygon has all its vertices on one line": ("it has no inside", _MEND),
    "the polygon is too complex to be checked; use fewer vertices": ("nearly all edges lie close together", _MEND),
    "the polygon ends after <number> of <number> vertices": ("vertices are missing", _MEND),
    "vertex <number> of <number> is not one of its polygon": ("two polygons are mixed", _MEND),
    "x is out of range": ("the item's place is broken", _MEND),
    "y is out of range": ("the item's place is broken", _MEND),
    "is numbered <number>": ("items of a plan file are not in order", _AGAIN),
    "holds a plan of kind <number> instead of <number>": ("the file went to the wrong name", _AGAIN),
    "only whole plans are taken": ("a plan file begins with its first item", _AGAIN),
    "<number> bytes do not hold <number> items": (_BROKEN, _AGAIN),
    "shorter than its head": (_BROKEN, _AGAIN),
    "begins with <number> instead of <number>": (_BROKEN, _AGAIN),
    "byte <number> begins no parameter": (_BROKEN, _AGAIN),
    "the parameter at byte <number> is cut off": (_BROKEN, _AGAIN),
    "unknown parameter <name>": ("the file is of another version", "leave that parameter out"),
    "<number> bytes of <number> have come": (_BROKEN, _AGAIN),
    "<number> parameters instead of <number>": (_BROKEN, _AGAIN),
    "<number> values for <number> parameters": (_BROKEN, _AGAIN),
    "expected NAME VALUE, found <line>": ("a parameter file has a line of another kind", "mend the line"),
    "<value> is not a number": ("in a parameter file", "mend the line"),
    "Disk busy: send the file again": ("too many files wait to be written", "send it again"),
    "<name>: upload incomplete, send the file again": (
        "the file was ended before all of it had come; what was there before stands",
        "send it again",
    ),
    "Upload aborted: file unchanged": (
        "a station that stopped during an upload has started again",
        "send the file again",
    ),
    "Log download refused: server busy, try again": ("four stations fetch logs at once", "try again later"),
    "Log <number> does not exist": ("the list is old, or the log has been tidied away", "list the logs again"),
    "Log erase refused: armed, disarm first": ("logs are protected under way", "disarm first"),
    "Logs could not be erased: <why>": ("some logs are still there", "see what is named; STORAGE_FAILING"),
    "<number> logs erased": ("the log that is being written stays", "nothing"),
}
