"""Mathematics of small arrays: vectors, versors, norms, series, brackets of zeros; programs as expressions of elements.

It contains nothing specific to bodies, solvers or files.
"""
