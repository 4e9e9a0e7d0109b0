"""A catalogue that the tests of several commands read."""

import pytest

from branches.catalogue import Catalogue, Edge, Node
from branches.catalogue.members import orbit_of_event, switch_edge
from tests.branches.catalogue.families import linear_mode, real, scene


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    """Standard error without lines that depend on the speed of the machine, and on what was compiled before."""
    monkeypatch.setattr("saltus.compiling.announce", lambda calls: None)
    monkeypatch.setattr("saltus.terminal.PAUSE", float("inf"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder, in which the commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def catalogue(tmp_path_factory):
    """Four families, the symmetry breaking, a linear mode with its grazing, and a dead end."""
    path = tmp_path_factory.mktemp("catalogue") / "real.sqlite"
    backbone, _, _, born = real()
    at = {event.id: event for event in backbone.events}
    with Catalogue(path, "a", scene=scene()) as filled:
        for branch in real():
            filled.add(branch)
        filled.connect(switch_edge(backbone, at["SB1"], born))
        graze = at["GR1"]
        filled.add_node(Node("L11+", "linear mode", "L11+", (0.0, graze.h), graze.alpha))
        filled.connect(
            Edge("L11+", "", "GR", "linear mode", backbone.id, graze.h, graze.alpha, "GR1", graze.stop, None,
                 linear_mode(graze.h), orbit_of_event(backbone, graze))
        )  # fmt: skip
        end = at["GR2"]
        filled.connect(
            Edge(backbone.id, "GR2", "GR", "dead end", None, end.h, end.alpha, "", end.stop, "no admissible neighbour",
                 orbit_of_event(backbone, end))
        )  # fmt: skip
    return path
