"""The problems of the benchmark."""

from ..problem import Problem
from .rolling import BALL, BALL_DAE, BALL_DAE_PAPER, DISK
from .stiff import HIRES, OREGO, ROBERTSON, ROBERTSON_DAE, VAN_DER_POL, VAN_DER_POL_SCALED

ALL: dict[str, Problem] = {
    problem.name: problem
    for problem in (
        DISK,
        BALL,
        BALL_DAE,
        BALL_DAE_PAPER,
        ROBERTSON,
        ROBERTSON_DAE,
        VAN_DER_POL,
        VAN_DER_POL_SCALED,
        HIRES,
        OREGO,
    )
}
