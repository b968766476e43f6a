"""Heading control: from a heading error to a rudder angle."""
