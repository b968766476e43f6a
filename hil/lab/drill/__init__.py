"""Fault drills: every fault is injected on a simulated boat, in several situations and in pairs."""
