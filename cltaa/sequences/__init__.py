"""Folders of numbered frames, opened as a whole, read ahead of need and written behind it."""
