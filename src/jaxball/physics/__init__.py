"""The mechanics: what systems are made of, their equations of motion, and what is read off their states.

Pure functions of arrays: no integrator, no figures and no files are imported here.
"""
