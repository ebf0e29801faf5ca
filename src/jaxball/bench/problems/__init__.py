"""The problems of the benchmark."""

from ..problem import Problem
from .ball import BALL
from .ball_dae import BALL_DAE, BALL_DAE_PAPER
from .disk import DISK
from .hires import HIRES
from .orego import OREGO
from .robertson import ROBERTSON, ROBERTSON_DAE
from .van_der_pol import VAN_DER_POL, VAN_DER_POL_SCALED

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
