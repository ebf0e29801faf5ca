"""A design problem: what may change, and what is wanted of the motion.

``space`` makes candidates of variables, which are numbers of a scenario within their bounds; ``run`` simulates one.
``requirements`` has the contracts of objectives and constraints, some of them about positions in the plane, and
``problem`` puts all of this together. The rest of the design imports these modules, and they import none of it.
"""
