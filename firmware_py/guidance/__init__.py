"""Guidance: computes the heading to steer from mode, goal and mission."""
