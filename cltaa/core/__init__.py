"""The resolve: frames in, images out, without files."""
