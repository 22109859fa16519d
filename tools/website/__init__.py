"""The pages of docs/ as a site: the staged files for Sphinx, and its configuration and extensions."""
