"""Controllers side by side in the same seas: the autopilot as it is, with fixed gains, and a tuned PID."""
