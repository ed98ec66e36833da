"""The exception of the user's mistakes; apart from the rooms that raise it, so that the command line starts at once."""


class ConfigError(ValueError):
    """A mistake in a config or on the command line, in one sentence for people."""
