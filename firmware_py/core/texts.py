"""The STATUSTEXTs of modes, navigation and sensors: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_NOTHING = "nothing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Power monitor: <what it reports>": (
        "a charger reports an error of its own; told once in ten minutes at most",
        "the number is in its manual; `rambler status` has the latest, and which device it is",
    ),
    "Armed": ("the rudder follows the mode from now on", _NOTHING),
    "Disarmed": ("the rudder is not steered any more", "arm her when she is to sail"),
    "Mode <mode>": ("she has entered a mode, by your order or a failsafe's", _NOTHING),
    "Failsafe: <mode>": (
        "a fault that stands has chosen this mode, as its `FS_...` parameter says",
        "see the fault told just before; any order of yours overrules it until the fault comes again",
    ),
    "Failsafe: <mode>, <mode> is impossible": (
        "a failsafe could not enter the mode that it was to, and took the next best",
        "see the fault told just before, and what the better mode needs (position, home, heading)",
    ),
    "Failsafe over: <mode> goes on": ("the fault is gone, she does again what she did before (`FS_RESUME`)", _NOTHING),
    "Failsafe over: <mode> stays": (
        "the fault is gone, and `FS_RESUME` says that you choose what she does now",
        "choose a mode",
    ),
    "Failsafe over: <mode> stays, <why>": (
        "the fault is gone, and what she did before is not possible now",
        "mend what is named, or choose a mode",
    ),
    "Compass <A or B> states variation <angle>: <angle> is used": (
        "the compass states a variation that differs by more than 3 deg from the declination that is configured",
        "correct the place or variation in the instrument, or `CMP_DECL_DEG` or `CMP_DECL_AUTO`",
    ),
    "Compass <A or B> states deviation <angle>: <use>": (
        "the field of the deviation has what must be the variation, as from early versions of Signal K",
        "mend what sends the sentence; see whether the heading is right",
    ),
    "Compass <A or B>: stated variation agrees": (
        "the stated variation no longer differs from the declination that is configured",
        "nothing",
    ),
    "First position was <distance> km off: home and tasks move": (
        "the first place was wrong: home and goal near it move along, loiter point and water are taken again",
        "check home and task on the map",
    ),
    "Position believed where it jumped to: <distance> m off": (
        "fixes that were held back bear each other out, or she can have sailed there by now: she goes on from there",
        "look whether she can be there: a deceived receiver is as sure of it; HOLD and STEERING need no position",
    ),
    "Goes on by reckoning from the last fix": (
        "the position is lost; she goes on by heading, speed and the water as last known, less certain with time",
        "see POSITION_LOST; `rambler status` has the place and its standard deviation",
    ),
    "Reckoned to be there: waits for a fix to say so": (
        "she is at the place by a reckoning less certain than its radius: nothing counts as reached, she keeps station",
        "see POSITION_LOST; set another item or a heading if you know better",
    ),
    "Reckoned too coarsely: waits here for a fix": (
        "the reckoned place has become less certain than `POS_RECKON_M`: she keeps station about where she may be",
        "see POSITION_LOST; set a heading, or a larger `POS_RECKON_M`, if the sea about her is free",
    ),
    "Rudder hard over for 5 min: she does not come round": (
        "more than 15 deg off her heading and no nearer for so long: a calm, weed on the blade, too strong a wind",
        "wait for the calm to end; another heading, on which she needs less rudder; look for weed and lines",
    ),
    "Reckoned for <number> min: she was <distance> m off": (
        "fixes are back after so long: so far from there she had been reckoned to be",
        _NOTHING,
    ),
    "Position moves <speed> m/s otherwise than its velocity says: is the receiver deceived?": (
        "for four minutes her places have gone elsewhere than the receiver's velocities; she goes by the places",
        "look whether she can be there; HOLD and STEERING need no position",
    ),
    "Position has not moved for <number> min, to the last digit: does the receiver hold it?": (
        "armed, she is given the very same place: if it holds still what is slow it is believed, if it hangs not",
        "switch off what its maker calls static hold or static navigation; STEERING needs no position",
    ),
    "Mission: item <number>": ("she goes on with this item, numbered as stations do: home is 0", _NOTHING),
    "Fence heeded": ("a command or an item of the mission asks for it", _NOTHING),
    "Fence not heeded": (
        "a command or an item of the mission asks for it",
        "DO_FENCE_ENABLE has it kept",
    ),
    "No fence to heed: send one": (
        "a DO_FENCE_ENABLE of the mission asks for a fence, and she has none",
        "send a fence; it is heeded as soon as it is there",
    ),
    "Watch circle of <radius> m: in a current she holds no less than <radius> m": (
        "she cannot stop: in a current she leaves so small a circle again and again, by some 3.5 of her turning radii",
        "`LOIT_RADIUS`, or the radius of the item, no smaller than the second number, where that matters",
    ),
    "Circle of <radius> m: too tight, she goes round at <radius> m": (
        "at full rudder she does not turn so tightly; she goes round on the tightest circle that she can keep",
        "a larger radius of the item, if the circle matters",
    ),
    "Fence is near: watch circle of <radius> m, moved <distance> m inward": (
        "she swings out of a watch circle by some 3.5 turning radii: it is moved, and made smaller if need be",
        "choose a place farther from the fence, if it matters where she stays",
    ),
    "Fence leaves no room for her watch circle: she may swing over it": (
        "nowhere near is the fence as wide as she needs to keep station; it may come to `FENCE_BREACHED`",
        "choose a place where the fence is wider, or widen it",
    ),
    "Mission complete: keeping station": (
        "the last item is done; she stays near it",
        "send another mission, or a mode",
    ),
    "Mission paused: keeping station": ("as you have ordered", "DO_PAUSE_CONTINUE (1) or AUTO again: she goes on"),
    "Mission paused after item <number>: no autocontinue": (
        "that item has no autocontinue, so she waits for you",
        "DO_PAUSE_CONTINUE (1), or name the item to go on with",
    ),
    "Mission goes on": ("the pause is over", _NOTHING),
    "Heading from <source>": ("she has found something to take her heading from", _NOTHING),
    "Heading from <source>, not <source>": (
        "she steers by another source: the better one has failed, or is back",
        "if it is a worse one: see the fault of the compass; by course over ground she steers roughly",
    ),
    "Heading lost: <source> fails": (
        "no source of heading is left; the rudder is held, then amidships (fault COMPASS_LOST)",
        "power and cable of the compass; `rambler listen`, once ashore",
    ),
    "Heading estimate restarted": (
        "a wave has turned the boat, or the compass has differed from the estimate for so long that it is used",
        "once: nothing; repeatedly: look for a compass that jumps, or for magnetic objects near it",
    ),
    "Clock set from <source>: it was <seconds> s off": ("the computer's clock has been set", _NOTHING),
    "Clock is <seconds> s off and may not be set (needs CAP_SYS_TIME)": (
        "log names and time stamps are wrong by this; steering is not concerned",
        "install her as the service (`rambler service install`), which may set the clock",
    ),
    "GPS date <date> cannot be: its time is not used": (
        "the receiver states a date before this program was made, or far ahead",
        "nothing, if it goes; an old receiver may have counted its weeks over: replace it",
    ),
    "<how long> ago: <text>": ("a warning of before this station was there, for faults: that stands", "see the text"),
    "GPS date is right again": ("the receiver's time is used again", _NOTHING),
    "GPS week rolled over: <date> is taken for <date>": (
        "an old receiver counts 1024 weeks and begins again; its date is mended here",
        "nothing; new firmware of the receiver cures it",
    ),
    "<signal>: she ends, the rudder goes amidships": (
        "somebody on the computer, or its service manager, ends her; a log whose last tick does not say so was cut off",
        "to go on: `systemctl start rambler`; she takes her task up again",
    ),
    "<signal>: <why>, she sails on": (
        "somebody on the computer has sent a signal that is not to end her",
        "to end her: `systemctl stop rambler`, or SIGTERM",
    ),
    "Link: <error> inside, she steers on": (
        "a defect of the program in the part that talks to you; it is begun anew, the loop has gone on",
        "keep the log and report it; if it comes often, use another link or station",
    ),
    "rambler status has nothing to show: <why>": (
        "the file that `rambler status` reads cannot be written",
        "room and rights of the runtime directory (`/run/rambler`)",
    ),
    "Compass calibration: turn her slowly through a full circle": (
        "the compass samples its own field",
        "turn her round within a quarter of an hour, with some pitch and roll; COMMAND_CANCEL breaks off",
    ),
    "Compass calibrated and saved: score <score>": ("the compass has kept its own calibration", _NOTHING),
    "Compass calibration was broken off": ("by your cancelling, or the compass did not go on", "try again"),
    "Compass calibration: <problem>": (
        "the compass's own calibration has ended without a result; the old one stands",
        "its power and cable; begin again, turning more slowly",
    ),
    "Compass calibration not saved: score <score>, at most <score>; switch the compass off and on": (
        "the compass's score is too bad to be kept; its old calibration comes back when it is switched off and on",
        "switch it off and on; try again away from iron, through the whole circle, with more pitch and roll",
    ),
}
