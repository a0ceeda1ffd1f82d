"""Files of any kind: complete or not there, read once, vouched for by their SHA-256."""
