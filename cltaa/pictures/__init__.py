"""From linear colour to what a person looks at: the display curve, PNG files and films."""
