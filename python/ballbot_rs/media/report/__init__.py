"""The report of a training run: its contents, and the page that shows them."""
