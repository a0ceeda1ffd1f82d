"""The resolve: frames in, anti-aliased images out, over a whole sequence and its files."""
