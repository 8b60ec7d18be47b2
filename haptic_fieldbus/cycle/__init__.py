"""The running plan: one input image in, one output image out, once a period."""
