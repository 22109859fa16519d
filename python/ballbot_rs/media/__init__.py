"""Videos, figures and reports."""
