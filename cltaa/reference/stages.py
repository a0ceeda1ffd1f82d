"""Twins of the stage kernels: the resolve cut at its stages, for tests and debug views."""
