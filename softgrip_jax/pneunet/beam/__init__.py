"""The beam of a finger: its equations, and how they are solved."""
