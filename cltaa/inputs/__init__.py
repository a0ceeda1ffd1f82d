"""Read sequences of other tools by profiles, which define names, units, signs and kinds of channels."""
