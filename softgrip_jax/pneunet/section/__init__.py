"""Section laws of the cover: bending moment and axial force against curvature and stretch; `base` says what one is."""
