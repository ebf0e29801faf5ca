"""Runs as one HTML file that shows them in three dimensions, with graphs over time beside them.

:mod:`.document` makes one dictionary of runs, of what :mod:`.body` knows of each and :mod:`.graphs` draws of all, with
its arrays by :mod:`.packing`, and :mod:`.page` writes it into the page. What the page does with it is in ``source``,
from which ``view.bundle.js`` is made; ``source/README.md`` says how.
"""
