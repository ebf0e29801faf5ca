"""The contenders. Nothing here imports a contender's package."""

from .base import Contender, Family

JAXBALL = Family("jaxball", "diffrax_")
DIFFRAX = Family("diffrax", "diffrax_")
SCIPY = Family("SciPy", "scipy_", ("scipy", "numba"))
NUMBALSODA = Family("numbalsoda", "numbalsoda_", ("numba", "numbalsoda"), extra="numbalsoda")
HEYOKA = Family("heyoka", "heyoka_", ("heyoka",))
CASADI = Family("CasADi", "casadi_", ("casadi",))
FAMILIES = (JAXBALL, DIFFRAX, SCIPY, NUMBALSODA, HEYOKA, CASADI)


def _ours(method: str, *, explicit: bool = False, daes: bool = False) -> Contender:
    return Contender(method, JAXBALL, method, explicit=explicit, daes=daes)


def _theirs(family: Family, method: str, *, explicit: bool = False, daes: bool = False) -> Contender:
    return Contender(f"{family.name} {method}", family, method, explicit=explicit, daes=daes)


# A fixed-point iteration limits the step like an explicit method's stability.
ALL: dict[str, Contender] = {
    contender.name: contender
    for contender in (
        _ours("Adams", explicit=True),
        _ours("Gauss", explicit=True),
        _ours("NDF", daes=True),
        _ours("RadauIIA 3", daes=True),
        _ours("RadauIIA 5", daes=True),
        _ours("RadauIIA 7", daes=True),
        _ours("RadauIIA 7 fixed-point", explicit=True),
        _ours("Trapezoidal", daes=True),
        _ours("TRBDF2", daes=True),
        _theirs(DIFFRAX, "Tsit5", explicit=True),
        _theirs(DIFFRAX, "Dopri5", explicit=True),
        _theirs(DIFFRAX, "Dopri8", explicit=True),
        _theirs(DIFFRAX, "Kvaerno5"),
        _theirs(SCIPY, "RK45", explicit=True),
        _theirs(SCIPY, "DOP853", explicit=True),
        _theirs(SCIPY, "LSODA"),
        _theirs(SCIPY, "Radau"),
        _theirs(SCIPY, "BDF"),
        _theirs(NUMBALSODA, "LSODA"),
        _theirs(NUMBALSODA, "DOP853", explicit=True),
        _theirs(HEYOKA, "Taylor", explicit=True),
        _theirs(CASADI, "CVODES Adams", explicit=True),
        _theirs(CASADI, "CVODES BDF"),
        _theirs(CASADI, "IDAS", daes=True),
    )
}
