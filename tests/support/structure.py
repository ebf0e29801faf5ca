"""A document of a scenario as a traceable function of its numbers, with the conditions on them."""

import jax

from jaxball.files.scenario.files import read_contents
from jaxball.files.scenario.traced import Parts, trace


class Structure:
    """A document as a function of the numbers at ``paths``; ``scenario`` and ``parts`` are its contents as it is."""

    def __init__(self, document, paths):
        self.document, self.paths = dict(document), paths
        contents = read_contents(self.document)
        self.scenario, self.parts = contents.scenario(), Parts.of(contents, self.document)
        self._build = jax.jit(lambda values: self.trace(values)[0])

    def build(self, values):
        """The contents of the document with ``values`` at ``paths``, possible or not."""
        return self._build(values)

    def conditions(self, values):
        """Whether each rule that involves ``values`` holds, by the path of the rule's key."""
        results = {}
        for path, holds in self.trace(values)[1].holds:
            results[path] = results[path] & holds() if path in results else holds()
        return results

    def trace(self, values):
        """The parts, and the conditions on them, of ``values`` that are traced."""
        return trace(self.document, self.paths, values)
