"""What a sequence holds, whether its pixels keep what it declares, and what a resolve of it will do."""
