"""A prediction and what the errors of the model make of it."""

import numpy as np

from hil.lab.identify.held_out import predictions
from hil.lab.identify.identify import identify


def test_a_prediction_is_as_unsure_as_the_model_and_more_so_the_further_it_goes(yard):
    """Nearly all by the rudder offset, which turns her by K times its error each second."""
    time = np.arange(3000) * 0.1
    rudder = yard.zigzag(time, np.radians(20.0), 40.0)
    recording = yard.recorded(time, rudder, *yard.boat(0.1, 6.0, 20.0, 0.01).motion(time, rudder), channels="r")
    found = identify([recording], [recording], model="linear")
    estimates = found.judgement.estimates
    for (shown,) in (found.validate[0].predictions, predictions(found.fit, found.fit.problem, found.fit.state)):
        unsure = shown.heading_se_rad
        assert unsure[0] == 0.0
        assert np.all(np.isfinite(unsure))
        turned = estimates["K"].value * estimates["delta0"].se * time[-1]
        assert 0.5 * turned < unsure[-1] < 2.0 * turned
