"""Measuring: time against the alternatives and the floor, and error against time."""
