"""Run the autopilot's estimators and monitors over a recording: `rambler-hil estimate`."""
