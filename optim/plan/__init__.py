"""The next experiment: which measurements tell most about parameters, or about a decision (`softgrip plan`)."""
