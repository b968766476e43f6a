"""The compiled loop: sea, ship, devices, estimators and controller in one compiled function.

Its results are identical to those of the autopilot in the harness, to the last bit.
"""
