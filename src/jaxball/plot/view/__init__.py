"""Runs as one HTML file that shows them in three dimensions, with graphs over time beside them.

:mod:`.page` makes one dictionary of runs, of the :mod:`.scene` that :mod:`.rolling` makes of bodies on a plane and
:mod:`.free` of others, and writes it into the page. What the page does with it is in ``source``, from which
``view.bundle.js`` is made; ``source/README.md`` says how.
"""
