"""Checks of the laws of mechanics on a run, and of how far ahead its result can be trusted.

No figures are drawn and no files written here.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .run import check_laws as check_laws
else:
    from ...interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
