"""Result files: a trajectory as a labelled data set, saved and loaded.

Nothing is solved or drawn here.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from ..interface.output import (
        OutputError as OutputError,
        check_destination as check_destination,
        replacing as replacing,
    )
    from .files import SUFFIXES as SUFFIXES, RunError as RunError
    from .loading import load_run as load_run, saved_scenario as saved_scenario
    from .saving import save as save, to_dataset as to_dataset
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
