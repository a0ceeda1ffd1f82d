"""EXR files, sequences, and every other file that is written."""
