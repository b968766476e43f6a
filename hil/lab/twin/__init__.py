"""The compiled loop: sea, ship, devices, estimate and controller of the delivered boat in one kernel, bit for bit."""
