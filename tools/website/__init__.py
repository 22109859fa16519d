"""The pages of docs/ as a site: what is staged for Sphinx, and what Sphinx is given to build it with."""
