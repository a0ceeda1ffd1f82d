"""Sequences that others wrote, read as a profile says: names, units, signs, kinds, and what to do without them."""
