"""Monitors of rudder, steering and power, and the failsafes; pure."""
