"""The parameters of messages by satellite, a part of the one table."""

from __future__ import annotations

from firmware_py.common.parameter_row import Parameter, real, whole

SATELLITE: tuple[Parameter, ...] = (
    real("SBD_CHECK_H", 12.0, 0.0, 720.0, "h", "Without a session for this long she looks for messages; 0: never."),
    whole("SBD_CREDIT_B", 50, 1, 340, "", "Bytes that one credit of the satellite's provider carries."),
    whole("SBD_CSQ_MIN", 2, 0, 5, "", "Weakest signal of the satellite, 0 to 5, with which a session is begun."),
    whole("SBD_DAY_CRED", 50, 0, 100_000, "", "Credits that messages by satellite may cost in a day of UTC; 0: any."),
    whole("SBD_MONTH_CRED", 1500, 0, 1_000_000, "", "Credits that they may cost in a month of UTC; 0: any."),
    real("SBD_MT_DAYS", 7.0, 0.1, 365.0, "d", "A keyed message to her that was written longer ago does not count."),
    real(
        "SBD_REPORT_MIN", 60.0, 0.0, 10_080.0, "min", "Interval of reports by satellite message; 0: another mode only."
    ),
)
