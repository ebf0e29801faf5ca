"""Result files: a trajectory as a labelled data set, saved and loaded.

Nothing is solved or drawn here.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from ...interface.output import OutputError as OutputError
    from .files import RunError as RunError
    from .loading import saved_scenario as saved_scenario
else:
    from ...interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
