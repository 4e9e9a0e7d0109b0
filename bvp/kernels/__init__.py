"""Compiled arithmetic of impacting systems: arrays and numbers in named tuples, without any policy. Comments cite docs/theory.md.

    compiled, stored           how kernels are declared and called; where their machine code is kept
    compiler, entry_point, indexing, declared, hook
                              how they are compiled
    flight                    exact flight, and bounds of a linear functional along it
    impact, extrema           next impact; sign changes and extrema of a linear functional
    contact_mode, sticking    restitution; sticking contacts, impacts beside them, the end of chattering
    energy_budget, motion     where the energy goes; the motion from event to event
    multipoint, newton, step  the boundary-value problem of an orbit under loads or in parameters, its corrections, the step along a family
"""
