"""The ship in the sea: heading, track, waves, drift, and the shaft of the rudder servo."""
