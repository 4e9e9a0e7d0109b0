"""The operations that objects offer as methods.

`Branch`, `Orbit`, `Motion` and `Catalogue` are data and import no operation. Importing this module adds the methods. `saltus` does it
before it hands out such an object.
"""

from __future__ import annotations

from branches.branch import Branch
from branches.catalogue import Catalogue
from branches.figures.plots import plot_branch, plot_catalogue, plot_motion, plot_orbit
from branches.grazing.following import neighbours
from branches.orbit import Orbit
from branches.record import save, to_dataframe
from branches.switching import switch
from branches.tracing import extend
from bvp.motion import Motion

__all__ = ["Branch", "Catalogue", "Motion", "Orbit"]

Branch.save = save
Branch.trace = extend
Branch.switch = switch
Branch.neighbours = neighbours
Branch.plot = plot_branch
Branch.to_dataframe = to_dataframe
Orbit.plot = plot_orbit
Motion.plot = plot_motion
Catalogue.plot = plot_catalogue
