"""Figures of what has no ``plot`` of its own: several results together, systems, data sets and rows of numbers.

A run, a regulator, a basin, an estimate and Lyapunov exponents draw themselves, as in ``run.plot("energies")``. Every
function here draws into ``ax`` and returns it; without one it makes a new figure, which is ``ax.figure``.
Functions with several panels return the figure. A new figure of a trajectory has a caption that says which system it
shows, and in what units; :func:`caption` replaces it. Figures of numbers alone have one if they are given the
``system``. No figure is registered with pyplot, and matplotlib's settings
are not changed.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .chaos import (
        chart as chart,
        eigenvalues as eigenvalues,
        poincare_section as poincare_section,
    )
    from .classical import law_errors as law_errors, law_residuals as law_residuals
    from .control import held_inputs as held_inputs, held_paths as held_paths
    from .coordinates import acceleration as acceleration
    from .designs import (
        branch as branch,
        convergence as convergence,
        designed_path as designed_path,
        place_in_time as place_in_time,
        rail_accelerations as rail_accelerations,
        rail_angles as rail_angles,
    )
    from .space import configuration as configuration
    from .style import ColourScale as ColourScale, caption as caption
    from .sweeps.figures import (
        sweep_fan as sweep_fan,
        sweep_figures as sweep_figures,
        sweep_map as sweep_map,
        sweep_slice as sweep_slice,
    )
    from .sweeps.matrix import sweep_matrix as sweep_matrix
    from .sweeps.rows import PictureError as PictureError, sweep_scale as sweep_scale
    from .time_series import measurements as measurements
    from .view.page import write_view as write_view
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
