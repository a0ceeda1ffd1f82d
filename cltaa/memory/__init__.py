"""Memory of a long run, laid out once for NumPy and for devices: planes with a halo, taken again frame after frame."""
