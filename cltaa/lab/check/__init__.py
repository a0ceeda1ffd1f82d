"""Find wrong conventions in a sequence from its pixels."""
