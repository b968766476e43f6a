"""K-T model of the boat, the velocity triangle, and the estimate that the control law takes; shared with the HIL."""
