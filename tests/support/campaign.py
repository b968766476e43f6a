"""Specifications of campaigns with changed keys."""

from hil.lab.campaign.engines import engine_of
from hil.lab.campaign.firmware_engine import FAULTS
from hil.lab.campaign.spec import parse

COMPILED = {
    "engine": "compiled",
    "runs": 8,
    "seed": 5,
    "seconds": 400,
    "goals": "0:0,60:60",
    "scenarios": ["tank", "swell+leeway=3"],
    "ship": {"K": {"uniform": [0.7, 1.4]}, "speed": [0.8, 1.2]},
    "with": {"receiver": {"latency_s": 0.5, "lost": [0.02, 1.0]}, "compass": True},
    "set": {"CTL_PRICE": [0.5, 1.0, 2.0]},
    "fail": {"rms_deg": 3.0},
}


def read(content=None, **changes):
    """Return a specification with changed keys; a key that is None is left out."""
    merged = {**(COMPILED if content is None else content), **changes}
    specification = {key: value for key, value in merged.items() if value is not None}
    return parse(specification, tuple(FAULTS), lambda spec: engine_of(spec).refusals(spec))
