"""How jaxball speaks: arguments checked, refusals and results in words, files written atomically, Ctrl-C.

It knows nothing of mechanics and imports no other room.
"""
