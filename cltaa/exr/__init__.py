"""OpenEXR files: what stands in one, checked before it is believed; pixels in and out."""
