"""Errors and scores of a result against the truth."""
