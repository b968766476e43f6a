"""The simulated ship in the sea: heading, track, waves, current, rudder servo, power and other ships."""
