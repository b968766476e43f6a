"""The tick: state, step, requests; pure."""
