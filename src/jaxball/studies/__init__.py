"""Many runs for one question: sweeps over parameters, and designs by gradients."""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import design as design, sweep as sweep
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
