"""Scenarios of many rows read at once: each number is put where it belongs, and what cannot be is found.

The result is that of reading each row's document, bit for bit, which is what happens wherever anything is in doubt.
"""

from .rows import read_rows as read_rows
