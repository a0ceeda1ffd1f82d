"""What is in a sequence."""
