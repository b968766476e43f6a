"""The tick: state, step and requests; pure functions."""
