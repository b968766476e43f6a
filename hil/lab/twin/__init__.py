"""The compiled loop: sea, ship, devices, estimators and controller in one compiled function, bit-identical."""
