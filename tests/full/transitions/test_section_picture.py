"""Long cases of tests/transitions/test_section_picture.py."""

import io

import numpy as np

from bvp.system import vibro_impact_nes
from transitions.section.figure import section_figure
from transitions.section.section import section
from transitions.section.view import SectionView


def test_motions_do_not_merge_into_solid_ink():
    """Oracle: the dark part of the rendered axes of a section with twice the motions of the gallery's; what is left out is said."""
    found = section(vibro_impact_nes(), 20.0, orbits=300, crossings=200)
    figure = section_figure([SectionView(found), SectionView(found)])
    figure.savefig(io.BytesIO(), format="png")
    axes = figure.axes[0]
    left, bottom, right, top = (int(edge) for edge in axes.transData.transform([(-0.95, -18.0), (0.95, 18.0)]).ravel())
    shade = np.asarray(figure.canvas.buffer_rgba())[::-1][bottom:top, left:right, 0]
    assert 0.1 < np.mean(shade < 128) < 0.3
    words = axes.get_title().split("(")[2]
    assert words.endswith("of 300 motions drawn)") and 20 < int(words.split()[0]) < 250
