"""Messages, checks of arguments, how objects print, atomic writes and Ctrl-C.

Nothing here knows any mechanics or imports another package of jaxball.
"""
