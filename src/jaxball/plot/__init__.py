"""Figures and animations of trajectories, with matplotlib.

Every plot function draws into ``ax`` and returns it; without one it makes a new figure, which is ``ax.figure``.
Functions with several panels return the figure. A new figure of a trajectory has a caption that says which system it
shows, and in what units; :func:`caption` replaces it. Figures of numbers alone have one if they are given the
``system``. No figure is registered with pyplot, and matplotlib's settings
are not changed.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .animation import Animation as Animation, animate as animate, snapshot as snapshot
    from .chaos import (
        chaos_chart as chaos_chart,
        eigenvalues as eigenvalues,
        lyapunov_convergence as lyapunov_convergence,
        multipliers as multipliers,
        poincare_section as poincare_section,
        stability_chart as stability_chart,
    )
    from .control import (
        basin_map as basin_map,
        gains as gains,
        held_inputs as held_inputs,
        held_paths as held_paths,
    )
    from .coordinates import (
        acceleration as acceleration,
        joint_angles as joint_angles,
        joint_efforts as joint_efforts,
        mass_angles as mass_angles,
    )
    from .designs import (
        branch as branch,
        convergence as convergence,
        designed_path as designed_path,
        place_in_time as place_in_time,
        rail_accelerations as rail_accelerations,
        rail_angles as rail_angles,
    )
    from .estimates import estimate as estimate
    from .lagrangian import lagrangian_motion as lagrangian_motion
    from .laws import classical_motion as classical_motion, law_errors as law_errors, law_residuals as law_residuals
    from .report import figures as figures, overview as overview
    from .space import (
        body_paths as body_paths,
        centre_path as centre_path,
        configuration as configuration,
        space_paths as space_paths,
    )
    from .style import ColourScale as ColourScale, caption as caption
    from .sweeps.figures import sweep_fan as sweep_fan, sweep_map as sweep_map, sweep_slice as sweep_slice
    from .sweeps.matrix import sweep_matrix as sweep_matrix
    from .sweeps.report import sweep_figures as sweep_figures
    from .sweeps.rows import PictureError as PictureError, sweep_scale as sweep_scale
    from .time_series import (
        angular_velocity as angular_velocity,
        attitude as attitude,
        centre_velocity as centre_velocity,
        contact_force as contact_force,
        energies as energies,
        friction_ratio as friction_ratio,
        height as height,
        measurements as measurements,
        own_states as own_states,
        power as power,
        slip_speed as slip_speed,
    )
    from .view.page import View as View, write_view as write_view
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
