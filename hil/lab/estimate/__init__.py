"""The autopilot's estimator and monitors run over a recording: `rambler-hil estimate`."""
