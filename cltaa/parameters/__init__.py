"""Every choice and number of the resolve, declared once: presets are sets of them, kernels are built from them."""
