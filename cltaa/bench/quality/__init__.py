"""Presets judged on the same frames: sequences, cells of the table, and the page that holds it."""
