"""Reproduction of the paper on synthetic tank data: manoeuvre, identification, tuning, closed-loop runs."""
