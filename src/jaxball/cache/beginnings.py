"""The first bytes of contents, which identify their kinds."""

NATIVE, XLA = b"native\n", b"xla\n"  # a program of one compiler or the other
REFUSAL = b"refused\n"  # the note that a program is not compiled natively
LIST = b"list\n"  # the keys of a command's programs
