"""Controllers and policies: resolves a name, a path or an object to a controller of robots."""
