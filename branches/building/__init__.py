"""Building the graph of all families of a system: seeds are followed, what is found gives new seeds, until none is left.

`frontier` is the queue of work on executors, `work` what is done for one seed, `build` the whole.
"""
