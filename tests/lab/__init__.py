"""The numerical core as tests see it: objects and functions on plain arrays and on systems and problems of the package.

A test imports nothing of the core itself: it makes a flight, a problem or a matrix here, and compares what comes back with its oracle.
What a public object of the package gives already (`MultipointProblem.solve`, `ForcedProblem.multipliers`, `saltus.simulate`, ...) is used
as it is, and is not here.

    flights     linear, loaded and smooth flights: end, derivatives, rates, bounds
    paths       along a flight: sign changes, clearance, next impact, integrals
    problems    an orbit's equations beside what the problems hand out: null vector, coordinates of arclength, sections, chatter
    matrices    determinants, eigenvalues, products, eliminations, modes
    programs    values and Taylor coefficients of expressions
    functions   test functions, and the search for events between samples
    limits      numbers at which the core changes its method
"""
