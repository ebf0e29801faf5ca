"""The search for a design: a nonlinear program, and the methods that minimise it over its unknowns y.

``program`` defines what is solved, and ``shooting`` makes one from a problem. ``lagrangian`` has its derivatives, and
``check`` compares them with others. ``minimise`` has the methods, which ``optimise`` applies, and it saves their
progress. ``design`` leads from the check to a design that ``verify`` has evaluated by other means.
"""
