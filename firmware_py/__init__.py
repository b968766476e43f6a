"""Rambler's onboard autopilot: sensors -> estimate -> guidance -> control -> actuator."""

__version__ = "0.1.0.dev0"
