"""Runs as one HTML file that shows them in three dimensions, with graphs over time beside them.

:mod:`.document` makes one dictionary of runs, of the :mod:`.scene` that :mod:`.rolling`, :mod:`.rigid` or
:mod:`.particle` makes of runs of one of the :mod:`.kinds`, with its arrays by :mod:`.packing` and graphs by
:mod:`.graphs`; :mod:`.page` writes it into the page. What the page does with it is in ``source``, from which
``view.bundle.js`` is made; ``source/README.md`` says how.
"""
