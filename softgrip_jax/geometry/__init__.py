"""Where the parts of a solved scene are: flat sections and a mesh in space. Pictures, reports and pages draw these."""

from ..names import listing as _listing
from .mesh import Mesh as Mesh
from .mesh import mesh as mesh
from .sections import Force as Force
from .sections import Outline as Outline
from .sections import Section as Section
from .sections import has_sections as has_sections
from .sections import sections as sections

__dir__ = _listing(globals())
