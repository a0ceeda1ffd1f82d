"""cltaa: capture, resolve and judge temporal anti-aliasing."""
