"""Names of environments."""

BALANCE = "ballbot/Balance-v0"
