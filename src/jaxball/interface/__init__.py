"""Messages, checks of arguments, how objects print, atomic writes, lines of progress and Ctrl-C.

Nothing here contains any mechanics or imports another package of jaxball.
"""
