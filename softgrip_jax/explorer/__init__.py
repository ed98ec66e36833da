"""A live explorer of one scene in the browser: `softgrip explore scene.toml`, `sg.explore(scene)`."""

from .start import Explorer as Explorer
from .start import explore as explore
