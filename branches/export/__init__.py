"""Data of figures as files - CSV, JSON, NPZ, MAT - and back; each figure can be drawn again from its data."""
