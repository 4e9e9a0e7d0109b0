"""saltus follows families of periodic orbits of mechanical systems with impacts, and reports their stability.

>>> import saltus
>>> saltus.vibro_impact_nes(mu=0.1, sigma=0.1).degrees_of_freedom
2

A name is imported when it is first used. So ``import saltus`` is fast.
"""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # The redundant aliases mark the names as public for type checkers.
    from branches.branch import Branch as Branch
    from branches.branch import BranchEvent as BranchEvent
    from branches.catalogue import Catalogue as Catalogue
    from branches.catalogue import Edge as Edge
    from branches.catalogue import Node as Node
    from branches.catalogue.members import switch_edge as switch_edge
    from branches.catalogue.packing import pack_family as pack_family
    from branches.export.figure_data import read_atlas as read_atlas
    from branches.export.figure_data import write_atlas as write_atlas
    from branches.figures.atlas import draw_atlas as draw_atlas
    from branches.figures.atlas_data import atlas_of as atlas_of
    from branches.grazing.following import Neighbour as Neighbour
    from branches.grazing.following import neighbours as neighbours
    from branches.impulsive.motions import impulsive_manifold as impulsive_manifold
    from branches.impulsive.orbits import impulsive_orbits as impulsive_orbits
    from branches.linear_modes import LinearMode as LinearMode
    from branches.linear_modes import families_at as families_at
    from branches.linear_modes import linear_modes as linear_modes
    from branches.orbit import Orbit as Orbit
    from branches.reading import read_branch as read_branch
    from branches.reading import read_orbit as read_orbit
    from branches.search.discovery import Discovery as Discovery
    from branches.switching import switch as switch
    from branches.tracing import extend as extend
    from bvp.forcing import Constant as Constant
    from bvp.forcing import Harmonic as Harmonic
    from bvp.forcing import Record as Record
    from bvp.forcing import ground_load as ground_load
    from bvp.motion import Motion as Motion
    from bvp.simulate import Simulator as Simulator
    from bvp.simulate import simulate as simulate
    from bvp.system import ImpactSystem as ImpactSystem
    from bvp.system import Stop as Stop
    from bvp.system import vibro_impact_nes as vibro_impact_nes
    from saltus.__main__ import main as main
    from saltus.families import discover as discover
    from saltus.families import trace as trace
    from saltus.scene import Scene as Scene
    from saltus.scene import load_scene as load_scene
    from transitions.empirical import decompose as decompose
    from transitions.families import families_of as families_of
    from transitions.figures.transition import draw_transition as draw_transition
    from transitions.ground_motion import Ground as Ground
    from transitions.ground_motion import record_text as record_text
    from transitions.ground_motion import synthetic_record as synthetic_record
    from transitions.record import extents as extents
    from transitions.record import sampled as sampled
    from transitions.section.section import Section as Section
    from transitions.section.section import section as section
    from transitions.sharing import Sharing as Sharing
    from transitions.sharing import sharing_of as sharing_of
    from transitions.stage import changes as changes
    from transitions.stages import stages_of as stages_of
    from transitions.study.runs import Ending as Ending
    from transitions.study.study import Study as Study
    from transitions.transition import Transition as Transition
    from transitions.transition import read_transition as read_transition
    from transitions.transition import write_transition as write_transition

__version__ = "0.1.0"

_HOME = {
    "branches.branch": "Branch BranchEvent",
    "branches.catalogue": "Catalogue Edge Node",
    "branches.catalogue.members": "switch_edge",
    "branches.catalogue.packing": "pack_family",
    "branches.figures.atlas": "draw_atlas",
    "branches.figures.atlas_data": "atlas_of",
    "branches.export.figure_data": "read_atlas write_atlas",
    "branches.grazing.following": "Neighbour neighbours",
    "branches.impulsive.motions": "impulsive_manifold",
    "branches.impulsive.orbits": "impulsive_orbits",
    "branches.linear_modes": "LinearMode families_at linear_modes",
    "branches.orbit": "Orbit",
    "branches.reading": "read_branch read_orbit",
    "branches.search.discovery": "Discovery",
    "branches.switching": "switch",
    "branches.tracing": "extend",
    "bvp.simulate": "Simulator simulate",
    "bvp.forcing": "Constant Harmonic Record ground_load",
    "bvp.motion": "Motion",
    "bvp.system": "ImpactSystem Stop vibro_impact_nes",
    "saltus.__main__": "main",
    "saltus.families": "discover trace",
    "saltus.scene": "Scene load_scene",
    "transitions.figures.transition": "draw_transition",
    "transitions.empirical": "decompose",
    "transitions.families": "families_of",
    "transitions.ground_motion": "Ground record_text synthetic_record",
    "transitions.record": "extents sampled",
    "transitions.section.section": "Section section",
    "transitions.sharing": "Sharing sharing_of",
    "transitions.stage": "changes",
    "transitions.stages": "stages_of",
    "transitions.study.runs": "Ending",
    "transitions.study.study": "Study",
    "transitions.transition": "Transition read_transition write_transition",
}
"""The modules of the public names."""

_WITHOUT_METHODS = ("bvp.system", "bvp.forcing", "saltus.scene", "saltus.__main__")
"""Modules whose names lead to no object of `_add_methods`."""

_MODULES = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name from its module, and keep it."""
    if name not in _MODULES:
        raise AttributeError(f"module 'saltus' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULES[name]), name)
    if not _MODULES[name].startswith(_WITHOUT_METHODS):
        _add_methods()
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__


@functools.cache
def _add_methods() -> None:
    """Give `Branch`, `Orbit`, `Motion` and `Catalogue` their methods. They are data and import no operation."""
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.figures.plots import plot_branch, plot_catalogue, plot_motion, plot_orbit
    from branches.grazing.following import neighbours
    from branches.orbit import Orbit
    from branches.record import save, to_dataframe
    from branches.switching import switch
    from branches.tracing import extend
    from bvp.motion import Motion

    Branch.save = save
    Branch.trace = extend
    Branch.switch = switch
    Branch.neighbours = neighbours
    Branch.plot = plot_branch
    Branch.to_dataframe = to_dataframe
    Orbit.plot = plot_orbit
    Motion.plot = plot_motion
    Catalogue.plot = plot_catalogue
