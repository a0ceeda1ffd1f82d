"""A result against the truth: errors, scores in time, and whether two sequences show the same."""
