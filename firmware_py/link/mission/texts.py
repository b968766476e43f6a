"""STATUSTEXTs of plans, files and logs: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_CORRECT_ITEM = "correct the named item and upload the plan again; the old plan stays active"
_UPLOAD_AGAIN = "upload it again; the old one stays active"
_INVALID_FILE = "the file is incomplete or of another type"

TEXTS: Mapping[str, tuple[str, str]] = {
    "New <plan>: <number> items": ("the plan is active and on disk", "nothing"),
    "New <plan>: items <number> to <number>": ("the mission is active and on disk; home is item 0", "nothing"),
    "<item> is <number> m outside the fence": (
        "if the fence is enabled, `FS_FENCE_ACT` takes effect there",
        "move the item or the fence; `rambler plan check` names each item",
    ),
    "Leg to <item> leaves the fence by <number> m": (
        "both ends are inside, but the straight leg between them is not",
        "add a waypoint, or move the fence",
    ),
    "<item outside the fence>, and <number> more": ("several items are outside", "`rambler plan check` names each"),
    "First waypoint is taken as home and skipped": (
        "item 0 of a mission is home, as in ArduPilot; the station (such as MAVSDK's `Mission`) sent none",
        "send home as item 0; with MAVSDK use `MissionRaw`",
    ),
    "<plan> cleared": ("the plan is deleted, also on disk", "nothing"),
    "<plan> not cleared: <why>": ("the plan is unchanged", "remove the named cause and clear it again"),
    "<plan> rejected: <why>": ("the whole plan was refused; the reason is another row of this page", _CORRECT_ITEM),
    "it was refused": ("the plan was not accepted", _UPLOAD_AGAIN),
    "Mission item <number> refused": ("the mission continues with the present item", "name an existing item"),
    "plan not stored; the old one stays active": ("the plan could not be written to disk", "see STORAGE_FAILING"),
    "the plan has changed during the upload": (
        "another station has changed it during the upload",
        "read the plan, then send it again",
    ),
    "no such items to overwrite": ("a partial upload refers to items that do not exist", _UPLOAD_AGAIN),
    "station silent at item <number>": ("the upload has stopped for several seconds", _UPLOAD_AGAIN),
    "replaced by system <number>": ("another station uploads now", "wait for it, then send again"),
    "system <number> is uploading": ("another station uploads now", "wait for it, then send again"),
    "<number> items; at most <number> are supported": ("the plan is too long", "shorten it; DO_JUMP repeats a part"),
    "<command> is not known in a <plan> plan": ("the item is not supported; see plan items", _CORRECT_ITEM),
    "<item>: frame <number> is not supported": ("positions must be latitude and longitude", _CORRECT_ITEM),
    "<item>: param<number> is infinite": ("an invalid number", _CORRECT_ITEM),
    "<item>: param<number> is <value>; allowed: <values>": ("the value is not allowed", _CORRECT_ITEM),
    "<item>: position 0, 0 is not accepted": ("stations send this if no position was set", _CORRECT_ITEM),
    "<item>: the latitude is out of range": ("beyond 90 deg or not a number", _CORRECT_ITEM),
    "<item>: the longitude is out of range": ("beyond 180 deg or not a number", _CORRECT_ITEM),
    "<item>: the altitude is infinite": ("an invalid number", _CORRECT_ITEM),
    "<item>: the altitude is not a number": ("an invalid number", _CORRECT_ITEM),
    "<item>: a time must be -1, or 0 or more": ("-1 means any", _CORRECT_ITEM),
    "<item>: a time of day needs an hour": ("minutes or seconds without an hour", _CORRECT_ITEM),
    "DO_JUMP: param1 is home, not a mission item": ("the jump leads to item 0", _CORRECT_ITEM),
    "DO_JUMP: the target item does not exist": ("the jump has no target", _CORRECT_ITEM),
    "DO_JUMP_TAG: no JUMP_TAG with this tag": ("the jump has no target", _CORRECT_ITEM),
    "CONDITION_DISTANCE: no item with a position follows": (
        "no waypoint follows before the next jump, so that there is no distance",
        _CORRECT_ITEM,
    ),
    "<item>: endless loop without an item that takes time": ("the mission would never continue", _CORRECT_ITEM),
    "a second fence return point": ("only one is allowed", _CORRECT_ITEM),
    "the polygon crosses itself": ("inside and outside are ambiguous", _CORRECT_ITEM),
    "the polygon has fewer than 3 different vertices": ("the polygon has no area", _CORRECT_ITEM),
    "the polygon has all its vertices on one line": ("the polygon has no area", _CORRECT_ITEM),
    "the polygon is too complex to be checked; use fewer vertices": (
        "too many edges are close together",
        _CORRECT_ITEM,
    ),
    "the polygon ends after <number> of <number> vertices": ("vertices are missing", _CORRECT_ITEM),
    "vertex <number> of <number> is not one of its polygon": ("two polygons are mixed", _CORRECT_ITEM),
    "x is out of range": ("invalid position of the item", _CORRECT_ITEM),
    "y is out of range": ("invalid position of the item", _CORRECT_ITEM),
    "is numbered <number>": ("items of a plan file are not in order", _UPLOAD_AGAIN),
    "plan type <number> instead of <number>": ("the file has the name of another plan", _UPLOAD_AGAIN),
    "partial plan files are not supported": ("a plan file must begin with its first item", _UPLOAD_AGAIN),
    "<number> bytes do not match <number> items": (_INVALID_FILE, _UPLOAD_AGAIN),
    "file shorter than its header": (_INVALID_FILE, _UPLOAD_AGAIN),
    "begins with <number> instead of <number>": (_INVALID_FILE, _UPLOAD_AGAIN),
    "no valid parameter at byte <number>": (_INVALID_FILE, _UPLOAD_AGAIN),
    "the parameter at byte <number> is cut off": (_INVALID_FILE, _UPLOAD_AGAIN),
    "unknown parameter <name>": ("the file is of another version", "remove that parameter"),
    "<number> of <number> bytes received": (_INVALID_FILE, _UPLOAD_AGAIN),
    "<number> parameters instead of <number>": (_INVALID_FILE, _UPLOAD_AGAIN),
    "<number> values for <number> parameters": (_INVALID_FILE, _UPLOAD_AGAIN),
    "expected NAME VALUE, found <line>": ("invalid line in a parameter file", "correct the line"),
    "<value> is not a number": ("invalid value in a parameter file", "correct the line"),
    "Disk busy: send the file again": ("too many files are queued for writing", "send the file again"),
    "<name>: upload incomplete, send the file again": (
        "the upload ended before the file was complete; the old file is unchanged",
        "send the file again",
    ),
    "Upload aborted: file unchanged": (
        "a station that stopped during an upload has started again",
        "send the file again",
    ),
    "Log download refused: server busy, try again": ("four stations are downloading logs", "try again later"),
    "Log <number> does not exist": ("the list is old, or the log has been deleted", "list the logs again"),
    "Log erase refused: armed, disarm first": ("logs are protected under way", "disarm first"),
    "Logs could not be erased: <why>": ("some logs remain", "remove the named cause; see STORAGE_FAILING"),
    "<number> logs erased": ("the current log remains", "nothing"),
}
