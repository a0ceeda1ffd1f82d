"""A sequence to a folder."""
