"""Options that several commands share: every command spells, explains and orders them alike."""
