"""The mechanics: the parts of systems, their equations of motion, and the observables of their states.

Pure functions of arrays: no integrator, no figures and no files are imported here.
"""
