"""The parameter protocol, and what parameters mean to ground stations."""
