"""Third-party learners, each in a separate environment: `make consumers`."""
