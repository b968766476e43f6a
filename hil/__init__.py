"""Test harness: simulated ship, sea and byte-level devices for the unchanged autopilot."""
