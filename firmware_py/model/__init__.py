"""K-T model, velocity triangle and input of the control law; also used by the HIL."""
