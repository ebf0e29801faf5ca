"""Commands of the command line, one per file: their options, and what is refused before JAX is imported."""
