"""Comparison of controllers in the same seas: the autopilot, the autopilot with fixed gains, and a tuned PID."""
