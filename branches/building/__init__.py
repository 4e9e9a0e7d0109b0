"""Building the graph of all families of a system: seeds are followed, what is found gives new seeds, until none is left.

`bounds` says how far to go, `levels` at which energies to search, `seeds` what there is to do, `work` does it for one seed, `frontier` is
the queue of work on executors, `grazings` which grazing orbits are unfolded already, `build` the whole.
"""
