"""The rows of the table of parameters that tell what is done about other vessels."""

from __future__ import annotations

from firmware_py.common.parameter_row import Parameter, choice, real

AIS: tuple[Parameter, ...] = (
    choice(
        "AIS_ACT",
        0,
        {0: "tell only", 1: "step aside"},
        "What is done when a vessel comes near. Stepping aside: in AUTO, GUIDED, RTL and LOITER she steers the heading "
        "within AIS_SECTOR_DEG that opens the distance most, inside the fence, until the vessel is past. She is slow: "
        "she can get off a line early and nothing else, and knows no rule of the road.",
    ),
    real(
        "AIS_NEAR_M",
        500.0,
        10.0,
        20000.0,
        "m",
        "A vessel under way is near when it comes closer than this, if both go on as they do.",
    ),
    real("AIS_NEAR_S", 1500.0, 60.0, 7200.0, "s", "How far ahead is looked for vessels that come near."),
    real(
        "AIS_SECTOR_DEG",
        60.0,
        5.0,
        80.0,
        "deg",
        "How far to either side of her way she steps aside: below 90, so that she always makes good some of it.",
    ),
    real(
        "AIS_STILL_M",
        100.0,
        10.0,
        20000.0,
        "m",
        "A vessel that lies still, a mark or a base station is near when she comes closer to it than this.",
    ),
    real("AIS_STILL_M_S", 0.5, 0.0, 10.0, "m/s", "A vessel slower than this over ground lies still."),
)
