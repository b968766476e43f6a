"""The compiled twin of the delivered boat: sea, ship, devices, estimate and helm as one kernel, bit for bit."""
