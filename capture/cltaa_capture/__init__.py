"""Draw jittered colour, depth and motion of a scene off-screen and write an EXR sequence."""
