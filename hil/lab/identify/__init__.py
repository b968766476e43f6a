"""Identification of K, T, alpha and delta0 from manoeuvres and onboard logs."""
