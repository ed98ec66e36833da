"""Shells by the arc model: a section across the width is a circular arc where it touches nothing."""
