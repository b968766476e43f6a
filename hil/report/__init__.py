"""Results of a run: figures, plots, pages."""
