"""The names of the laws, and their statements."""

BALANCES: dict[str, str] = {
    "energy": "E(t) − E(t0) = ∫ of the power of everything that does work: actuation, force, resistance, ground",
    "momentum": "the momentum about the contact point changes by the moments of all forces and by −ċ × P",
    "chaplygin": "ΛΠ is constant where the centre of mass is the geometric centre and no force acts",
    "jellett-rate": "d/dt (L·s) = L·(Ω × χ + χ̇) − s·(χ × F̃) + s·T̃, for any ball",
    "jellett": "L·s is constant for a body of revolution with fixed masses and no force",
    "routh": "Routh's integral is constant for the same bodies",
    "norm": "|q| = 1",
    "moving-energy": "E − W L changes by the work relative to a level turntable at the rate W, and by −∫ Ẇ L dt",
    "rolling": "z(t) − z(t0) = ∫ (ω × r e3 + u)₁₂, no slip at the contact point",
}
COMPARISONS: dict[str, str] = {
    "saved": "the given run, such as a saved one, agrees with its scenario",
    "error": "the run agrees with one at a tolerance of 1e-13",
    "convergence": "the error falls with the tolerance",
    "estimate": "the error is what errors between saved times have grown to",
    "derivative": "the derivative of the run's end agrees with differences of nearby runs",
    "solvers": "the run agrees with that of a solver of another family",
    "dae": "the run agrees with that of the differential-algebraic equations",
    "embedding": "a disk rolls like the ball in which it is embedded",
    "closed-form": "the run agrees with the solution in closed form",
}
LAWS: dict[str, str] = {
    **BALANCES,
    "contact": "N > 0: the plane holds what rolls on it",
    **COMPARISONS,
}
"""Every law by its name. A classical system has its own ``laws`` instead of the balances."""
