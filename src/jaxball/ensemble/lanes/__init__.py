"""Programs on many lanes."""

from .program import LaneProgram as LaneProgram, elements_of as elements_of
