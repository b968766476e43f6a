"""Assembly of the autopilot from a vehicle file; only this package connects its parts."""
