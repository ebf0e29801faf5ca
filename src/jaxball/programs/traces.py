"""Settings by which JAX's caches keep traces of one function for different purposes apart, such as for our compiler.

JAX traces all functions anew when a setting is added. So ``import jaxball`` adds them at once if JAX is there already:
the first use of jaxball may be within a user's trace.
"""

import dataclasses

from ..interface.compat import setting_of_traces


@dataclasses.dataclass(frozen=True)
class Finer:
    """By how much runs are solved more finely than they ask for.

    - ``tolerance``: the factor of their tolerances; ``steps``: that of their ``max_steps``.
    - ``met``: a list to which each run adds an entry when its tolerances are checked.
    """

    tolerance: float = 1.0
    steps: int = 1
    met: list[None] = dataclasses.field(default_factory=list, compare=False)


# Whether our own compiler compiles it.
natively = setting_of_traces(False)
# Whether it is differentiated in forward mode.
differentiated_forward = setting_of_traces(False)
# Whether it is a computation of jaxball's own, of which all is compiled as one program.
within_a_computation = setting_of_traces(False)
# Along which tangents the derivative is that by which steps are chosen, see ``derivatives.steering``.
steering = setting_of_traces("own")
# The ``Finer`` by which runs are solved; None if as they ask for.
finer = setting_of_traces(None)
