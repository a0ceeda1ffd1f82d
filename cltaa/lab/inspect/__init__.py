"""Inspect the contents of a sequence."""
