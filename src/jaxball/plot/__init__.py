"""Figures and animations of trajectories, with matplotlib.

Every plot function draws into ``ax`` and returns it; without one it makes a new figure, which is ``ax.figure``.
Functions with several panels return the figure. A new figure of a trajectory has a caption that says which system it
shows, and in what units; :func:`caption` replaces it. No figure is registered with pyplot, and matplotlib's settings
are not changed.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
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
    from .contact import height as height, slip_speed as slip_speed
    from .coordinates import mass_angles as mass_angles
    from .designs import (
        branch as branch,
        convergence as convergence,
        designed_path as designed_path,
        place_in_time as place_in_time,
        rail_accelerations as rail_accelerations,
        rail_angles as rail_angles,
    )
    from .mechanisms import joint_angles as joint_angles, joint_efforts as joint_efforts
    from .motion import attitude as attitude, centre_velocity as centre_velocity
    from .paths import body_paths as body_paths, centre_path as centre_path, space_paths as space_paths
    from .rails import configuration as configuration
    from .report import figures as figures, overview as overview
    from .residuals import law_residuals as law_residuals
    from .sensors import measurements as measurements
    from .snapshots import snapshot as snapshot
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
else:
    from ..interface.names import lazy_interface

    _NAMES = {
        "actuation": "acceleration",
        "animation": "animate",
        "chaos": "chaos_chart eigenvalues lyapunov_convergence multipliers poincare_section stability_chart",
        "classical": "classical_motion law_errors",
        "contact": "height slip_speed",
        "coordinates": "mass_angles",
        "designs": "branch convergence designed_path place_in_time rail_accelerations rail_angles",
        "mechanisms": "joint_angles joint_efforts",
        "motion": "attitude centre_velocity",
        "paths": "body_paths centre_path space_paths",
        "rails": "configuration",
        "report": "figures overview",
        "residuals": "law_residuals",
        "sensors": "measurements",
        "snapshots": "snapshot",
        "style": "caption",
        "sweeps.fans": "sweep_fan",
        "sweeps.maps": "sweep_map",
        "sweeps.matrix": "sweep_matrix",
        "sweeps.report": "sweep_figures",
        "sweeps.rows": "PictureError",
        "sweeps.scales": "sweep_scale",
        "sweeps.slices": "sweep_slice",
        "time_series": "angular_velocity contact_force energies friction_ratio power",
        "view.document": "ColourScale",
        "view.page": "View write_view",
    }
    __all__, __dir__, __getattr__ = lazy_interface(__name__, _NAMES)
