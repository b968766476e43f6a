"""The table of faults, and the latch that judges them over time; pure."""
