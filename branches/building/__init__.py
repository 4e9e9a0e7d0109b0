"""Building the graph of all families of a system: each seed is followed and gives new seeds, until none is left.

`plan` has the bounds, the energies of each level and the seeds. `work` does the work of one seed. `frontier` is the queue of work on
executors. `build` runs all of it.
"""
