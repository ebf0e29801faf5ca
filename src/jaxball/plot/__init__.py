"""Figures and animations of trajectories, with matplotlib.

Every plot function draws into ``ax`` and returns it; without one it makes a new figure, which
``ax.figure`` gives. Those of several panels return the figure. A new figure of a trajectory says above
it which system it shows, and in what units; :func:`caption` says it in other words. No figure is
registered with pyplot, and no setting of matplotlib is changed.
"""

from ..interface.names import interface as _interface
from .actuation import acceleration as acceleration
from .animation import animate as animate
from .branches import branch as branch, place_in_time as place_in_time
from .chaos import chaos_chart as chaos_chart, lyapunov_convergence as lyapunov_convergence
from .classical import classical_motion as classical_motion, law_errors as law_errors
from .configuration import configuration as configuration
from .designs import (
    convergence as convergence,
    designed_path as designed_path,
    rail_accelerations as rail_accelerations,
    rail_angles as rail_angles,
)
from .evolution import (
    angular_velocity as angular_velocity,
    contact_force as contact_force,
    energies as energies,
    friction_ratio as friction_ratio,
    power as power,
)
from .paths import body_paths as body_paths, centre_path as centre_path, space_paths as space_paths
from .phase_space import eigenvalues as eigenvalues, poincare_section as poincare_section
from .report import figures as figures, overview as overview
from .style import caption as caption
from .sweeps.errors import PictureError as PictureError
from .sweeps.fans import sweep_fan as sweep_fan
from .sweeps.maps import sweep_map as sweep_map
from .sweeps.matrix import sweep_matrix as sweep_matrix
from .sweeps.report import sweep_figures as sweep_figures
from .sweeps.slices import sweep_slice as sweep_slice

__all__, __dir__ = _interface(globals())
