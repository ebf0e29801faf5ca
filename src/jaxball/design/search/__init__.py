"""The search for a design: a nonlinear program, and the methods that minimise it over its unknowns y.

``program`` defines what is solved, with its Lagrangian's derivatives, which ``check`` compares with others, and
``shooting`` makes one from a problem. ``minimise`` has the methods, ``optimise`` applies them and saves the progress.
``design`` leads from the check to a design that ``verify`` has evaluated by other means.
"""
