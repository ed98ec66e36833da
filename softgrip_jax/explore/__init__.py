"""A live explorer of one scene in the browser: `softgrip explore scene.toml`, `sg.explore(scene)`."""
