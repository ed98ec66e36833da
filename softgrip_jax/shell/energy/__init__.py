"""The energy membrane: the shell as the minimum of an energy over all of its surface, against any obstacle."""
