"""Robust designs: numbers that scatter, what is wanted of all the parts that are cast, and the search for it."""
