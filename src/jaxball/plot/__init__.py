"""Figures and animations of trajectories, with matplotlib.

Every plot function draws into ``ax`` and returns it; without one it makes a new figure, which is ``ax.figure``. Those
with several panels return the figure. A new figure of a trajectory has a caption that says which system it shows, and
in what units; :func:`caption` replaces it. No figure is registered with pyplot, and matplotlib's settings stay as they
are.
"""

from ..interface.names import interface as _interface
from .actuation import acceleration as acceleration
from .animation import animate as animate
from .chaos import (
    chaos_chart as chaos_chart,
    eigenvalues as eigenvalues,
    lyapunov_convergence as lyapunov_convergence,
    multipliers as multipliers,
    poincare_section as poincare_section,
    stability_chart as stability_chart,
)
from .classical import classical_motion as classical_motion, law_errors as law_errors
from .configuration import configuration as configuration
from .contact import height as height, slip_speed as slip_speed
from .designs import (
    branch as branch,
    convergence as convergence,
    designed_path as designed_path,
    place_in_time as place_in_time,
    rail_accelerations as rail_accelerations,
    rail_angles as rail_angles,
)
from .measurements import measurements as measurements
from .mechanisms import joint_angles as joint_angles, joint_efforts as joint_efforts
from .paths import body_paths as body_paths, centre_path as centre_path, space_paths as space_paths
from .report import figures as figures, overview as overview
from .snapshot import snapshot as snapshot
from .style import caption as caption
from .sweeps.fans import sweep_fan as sweep_fan
from .sweeps.maps import sweep_map as sweep_map
from .sweeps.matrix import sweep_matrix as sweep_matrix
from .sweeps.report import sweep_figures as sweep_figures
from .sweeps.rows import PictureError as PictureError
from .sweeps.scales import sweep_scale as sweep_scale
from .sweeps.slices import sweep_slice as sweep_slice
from .time_series import (
    angular_velocity as angular_velocity,
    contact_force as contact_force,
    energies as energies,
    friction_ratio as friction_ratio,
    power as power,
)
from .view.document import ColourScale as ColourScale
from .view.page import View as View, write_view as write_view

__all__, __dir__ = _interface(globals())
