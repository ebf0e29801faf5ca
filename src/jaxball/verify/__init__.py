"""The laws of mechanics that a run must keep, checked, and how far ahead its result can be trusted.

No figures are drawn and no files written here.
"""

from ..interface.names import interface as _interface
from .report import Report as Report, Row as Row
from .run import LAWS as LAWS, verify as verify
from .trust import Trust as Trust

__all__, __dir__ = _interface(globals())
