"""What kernels run on: OpenCL devices, or the NumPy twins in their place; how each kernel is built for them."""
