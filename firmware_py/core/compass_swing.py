"""Compass swing on request of an operator: estimates the deviation of compass A from the ticks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from firmware_py.common.angles import degrees
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState, Event, Inputs, Severity
from firmware_py.common.reports import SwingReport

if TYPE_CHECKING:
    from firmware_py.estimate.deviation_estimator import DeviationEstimator

NO_REPORT = SwingReport()


class CompassSwing:
    """A compass swing. It continues after the first proposal, because the proposal improves with time."""

    def __init__(self) -> None:
        """Create an idle swing."""
        self._estimator: DeviationEstimator | None = None
        self._report = NO_REPORT
        self.former: Mapping[str, float] | None = None  # parameters replaced by an accepted proposal

    @property
    def is_running(self) -> bool:
        """Whether a swing is active."""
        return self._estimator is not None

    @property
    def report(self) -> SwingReport:
        """Progress, and the proposal if there is one."""
        return self._report

    def begin(self, parameters: ParameterSet) -> None:
        """Start a swing with the present parameters."""
        # Imported here because most runs do not need it.
        from firmware_py.estimate.deviation_estimator import DeviationEstimator  # noqa: PLC0415

        self._estimator = DeviationEstimator(parameters)
        self._report = SwingReport(CalibrationState.RUNNING)
        self.former = None

    def end(self, former: Mapping[str, float] | None = None) -> None:
        """End the swing and discard its result; `former`: parameters that were replaced by accepting it."""
        self._estimator, self._report, self.former = None, NO_REPORT, former

    def take(self, inputs: Inputs, parameters: ParameterSet) -> Iterator[Event]:
        """Process the inputs of a finished tick; yield an event at the first proposal."""
        estimator = self._estimator
        if estimator is None:
            return
        last_minute = estimator.state.last_minute
        estimator.set_parameters(parameters)
        estimator.take(inputs)
        if estimator.state.last_minute is last_minute:
            return
        previous, self._report = self._report.state, estimator.report()
        if self._report.state is CalibrationState.DONE and previous is not CalibrationState.DONE:
            yield Event(
                Severity.NOTICE, f"Compass swing: {_format_proposal(self._report)}; accept with DO_ACCEPT_MAG_CAL"
            )


def _format_proposal(report: SwingReport) -> str:
    values = zip("ABCDE", report.estimated_rad, strict=True)
    coefficients = " ".join(f"{letter} {degrees(value):.1f}" for letter, value in values)
    sd_deg, off_deg = degrees(report.sd_rad or 0.0), degrees(report.max_change_rad or 0.0)
    residuals = (report.residual_before_rad, report.residual_after_rad)
    residual_text = (
        ""
        if None in residuals
        else f", residual {degrees(residuals[0] or 0.0):.1f} to {degrees(residuals[1] or 0.0):.1f}"
    )
    return f"{coefficients} deg, sd {sd_deg:.1f}, error now {off_deg:.1f}{residual_text}"
