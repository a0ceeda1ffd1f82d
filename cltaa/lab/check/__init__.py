"""Whether a sequence means what it says."""
