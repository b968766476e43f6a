"""Campaigns: many runs drawn from one specification, sailed by the autopilot or by its twin, and what they came to."""
