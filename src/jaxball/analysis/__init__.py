"""What is known of motions: chaos, stability, and the laws that a run must obey."""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import chaos as chaos, stability as stability, verify as verify
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
