"""The search for a design: a nonlinear program, and the methods that minimise it over its unknowns y.

``program`` defines what is solved, with its Lagrangian's derivatives, and makes one from a problem. ``optimise`` has
the methods and saves the progress. ``design`` leads from a check of the gradient to a design that ``verify_design`` has
evaluated by other means.
"""
