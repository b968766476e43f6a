"""The parameter protocols, and the parameter files for ground stations."""
