"""The search for a design: a nonlinear program, and the methods that minimise it over its unknowns y.

``program`` defines what is solved, and ``shooting`` makes one from a problem. ``lagrangian`` has its derivatives, and
``check`` compares them with others. ``adam``, ``bfgs`` and ``newton`` take steps, by the ``settings``; ``optimise``
chooses between them, ``progress`` saves their state, and ``design`` leads from the check to a verified design.
"""
