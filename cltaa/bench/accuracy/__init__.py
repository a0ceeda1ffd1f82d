"""Error against time: every variant of the resolve over every sequence, and the report of it."""
