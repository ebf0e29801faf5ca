"""What contents begin with, by which their kinds are told apart."""

NATIVE, XLA = b"native\n", b"xla\n"  # a program of one compiler or the other
REFUSAL = b"refused\n"  # that a program is not compiled natively
LIST = b"list\n"  # the keys of a command's programs
