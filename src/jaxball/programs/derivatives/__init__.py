"""Derivatives of programs: rules of loops and rows, what depends on what, and what has no derivative."""
