"""A run as one HTML file that shows it in three dimensions, with graphs over time beside it.

:mod:`.document` makes one dictionary of a run, and :mod:`.page` writes it into the page. What the page does with it is
in ``source``, from which ``view.bundle.js`` is made; ``source/README.md`` says how.
"""
