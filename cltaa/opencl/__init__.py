"""Kernels on an OpenCL device."""
