"""Commands of the command line, one a file: their options, and what is refused before JAX is imported."""
