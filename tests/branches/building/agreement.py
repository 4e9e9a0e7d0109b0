"""Orbits that discovery lists at an energy against the families of a catalogue that cross it."""

import numpy as np

from branches.building.work import ends_of
from branches.catalogue import Catalogue
from branches.catalogue.members import KnownFamilies
from branches.search.discovery import discover_orbits

SAME = 1e-6
"""Quarter periods that are one."""


class Families:
    """The families of a catalogue that have a reversal."""

    def __init__(self, path):
        self.known, self.branches = KnownFamilies(), {}
        with Catalogue(path) as catalogue:
            for row in catalogue.families():
                if row.ends != "periodic":
                    self.branches[row.id] = catalogue.branch(row.id)
                    self.known.add(row.id, self.branches[row.id])

    def agree(self, system, energy, quarter_period, impacts):
        """Fail where discovery at an energy that the build did not search, with every kind of ends, and the families differ."""
        found = discover_orbits(system, energy, ends=ends_of(system), quarter_period=quarter_period, impacts=impacts)
        assert found.complete and self.differences(found, quarter_period, impacts) == ([], [], [])

    def differences(self, found, quarter_period, impacts):
        """Orbits on no family, orbits whose family does not cross there, crossings that are not listed: all empty where they agree."""
        places = [(orbit, self.known.find(orbit.problem, orbit.solution.y)) for orbit in found.orbits]
        unknown = [(orbit.label, orbit.problem.ends, orbit.problem.sequence, orbit.alpha) for orbit, place in places if place is None]
        listed = [(place.id, orbit.alpha) for orbit, place in places if place is not None]
        crossing = [
            (id, orbit.alpha)
            for id, branch in self.branches.items()
            for orbit in branch.orbits_at(energy=found.energy)
            if orbit.alpha <= quarter_period and len(orbit.impacts) <= 2 * impacts
        ]
        return unknown, unmatched(listed, crossing), unmatched(crossing, listed)


def unmatched(ones, others):
    """Those (id, quarter period) of one list that have none in the other."""
    return [one for one in ones if not any(one[0] == other[0] and abs(one[1] - other[1]) < SAME for other in others)]


def decided_stability(path):
    """Part of a catalogue's points whose stability is decided."""
    with Catalogue(path) as catalogue:
        stable = np.concatenate([catalogue.points(row.id)["stable"] for row in catalogue.families()])
    return np.mean(stable >= 0)
