"""Design by gradient: the search from many starts, trade-offs between goals, and their runs in folders."""
