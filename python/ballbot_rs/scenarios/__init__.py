"""Scenarios: test cases for robots, and the comparison of controllers in them."""
