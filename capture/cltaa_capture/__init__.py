"""Draws jittered colour, depth and motion of a scene off-screen and writes an EXR sequence."""
