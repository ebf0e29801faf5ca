"""Rails, motions and parameters that make a ball do what is wanted, found by gradients through the simulation."""

from .bounds import Bounds as Bounds
from .errors import DesignError as DesignError
from .space import Candidate as Candidate, DesignSpace as DesignSpace
from .variables import Variable as Variable
