"""How a design is searched for: a nonlinear program, and what brings its unknowns y to a minimum.

``program`` says what is solved, and ``shooting`` makes one of a problem. ``lagrangian`` has its derivatives, and
``check`` compares them with others. ``adam``, ``bfgs`` and ``newton`` take steps, by the ``settings``; ``optimise``
decides which, ``progress`` keeps what they have come to, and ``design`` goes from the check to a verified design.
"""
