"""From a heading error to a rudder angle."""
