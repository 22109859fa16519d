"""Controllers and policies: how a name, a path or an object becomes what drives robots."""
