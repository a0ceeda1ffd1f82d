"""The convention detector: what the pixels of a sequence say about the numbers that came with them."""
