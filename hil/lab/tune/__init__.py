"""Tuning of the heading controller: a search over a compiled closed loop."""
