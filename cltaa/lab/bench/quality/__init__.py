"""Scores of each preset on each scene."""
