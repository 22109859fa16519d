"""The controls of the page, a module for each tab, and its numbers."""
