"""The paper's chain on synthetic tank data: from the manoeuvre to the gains to closed-loop runs."""
