"""Processors: what they can do, LLVM for them, and the driver of a GPU."""
