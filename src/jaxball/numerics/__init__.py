"""Mathematics of small arrays: vectors, versors, linear systems, series, brackets of zeros; derivatives; batches.

Also compiled programs, and what identifies them. It contains nothing specific to bodies, solvers or files.
"""
