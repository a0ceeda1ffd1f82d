"""Frames in, images out: the resolve, which knows no file."""
