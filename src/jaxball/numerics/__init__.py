"""Mathematics of small arrays: vectors, versors, norms, series, brackets of zeros, where derivatives end; and programs
as expressions of their elements.

It knows nothing of bodies, solvers or files.
"""
