"""A design as it was built: measured parts, and the design file that follows from them (`softgrip measure`)."""
