"""From a vehicle file to a wired autopilot; the only composer."""
