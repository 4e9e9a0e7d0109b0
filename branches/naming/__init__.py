"""Labels and names of families, and the search that finds a family by its name."""
