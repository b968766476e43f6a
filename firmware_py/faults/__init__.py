"""Table of faults, and the latch that applies their debounce and clear times: pure functions."""
