"""The report of a training run: what is collected for it, and the page that shows it."""
