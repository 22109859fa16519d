"""Policies that come with the package: trained, judged in three engines, and what they transfer to."""
