"""Mathematics of small arrays: vectors, versors, linear systems, series, brackets of zeros; kinks of functions of time.

It contains nothing specific to bodies, solvers or files.
"""
