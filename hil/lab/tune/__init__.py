"""Choosing the gains of the heading controller: a compiled closed loop, and a search over it."""
