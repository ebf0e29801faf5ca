"""Commands of the command line, one per file: their options, what is refused before JAX is imported, and their work.

``add`` gives a parser the options of a command, and ``run`` runs it. A command imports at its top only what needs no
JAX, so that help and refusals are quick; the rest is imported in the functions that use it, after
:func:`~jaxball.cli.jax_setup.set_up_jax`.
"""
