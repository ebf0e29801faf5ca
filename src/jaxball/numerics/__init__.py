"""Mathematics of small arrays: vectors, versors, trigonometry, series, and where derivatives end.

It knows nothing of bodies, solvers or files.
"""
