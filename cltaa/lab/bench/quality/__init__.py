"""Scene by preset by score."""
