"""The picture of a run: its motion, where the energy goes, and its spectrum over the families that are known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.diagram.atlas_data import Atlas
    from transitions.transition import Transition

__all__ = ["draw"]


def draw(shown: Transition, catalogue: Catalogue | None, branch: Branch | None, path: Path, caption: str = "") -> None:
    """Draw a motion into a file, over the families of a catalogue, else over the one that it starts on; and over the linear modes."""
    from transitions.diagram.transition_picture import draw_transition

    draw_transition(shown, _behind(shown, catalogue, branch), path, caption=caption)


def _behind(shown: Transition, catalogue: Catalogue | None, branch: Branch | None) -> Atlas:
    if catalogue is not None:
        from transitions.transition import atlas_behind

        return atlas_behind(catalogue, shown)
    from branches.diagram.atlas_data import atlas_of

    energy = shown.record.energy[shown.record.energy > 0.0]
    branches = [] if branch is None else [branch]
    return atlas_of(shown.system.underlying, branches, energy=(0.5 * float(energy.min()), 2.0 * float(energy.max())))
