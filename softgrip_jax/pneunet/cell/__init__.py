"""The cell of a finger: chamber, walls, rims and cover of one segment together, near to finite elements."""

from .scene import Cell as Cell
