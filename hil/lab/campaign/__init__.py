"""Campaigns: many runs drawn from one specification, run by the autopilot itself or by its compiled loop."""
