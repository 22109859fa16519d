"""A trajectory as one HTML file, which replays it in the scene of the page without a server."""
