"""The search for the settings with the least error within a time, or the least time for an error."""
