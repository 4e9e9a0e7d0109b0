"""One damped motion of a scene: its start, its simulation, and the record, table and text that report it."""
