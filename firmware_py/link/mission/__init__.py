"""The mission protocol: missions, fences, rally points."""
