"""What tells of the user's mistakes; apart from the rooms that raise it, so that the command line starts at once."""


class ConfigError(ValueError):
    """A mistake in a config or on the command line, in one sentence for people."""


class UnitWarning(UserWarning):
    """A number that can be meant, but was probably given in another unit than the SI unit that was asked for."""
