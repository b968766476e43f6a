"""Pages of voyages for a browser: of a run, of logs, and the live page."""
