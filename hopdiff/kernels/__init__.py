"""Compiled kernels of the whole body: traced once, kept on the user's disk, the same for every body and speed."""
