"""Numbers at which the core changes its method, and names of what it returns."""

from branches.kernels.functions import COMMON
from bvp.kernels.extrema import TIE
from bvp.kernels.impact import CONTACT_TOLERANCE
from bvp.kernels.monodromy import FORMED_LIMIT, GRADE

__all__ = ["COMMON", "CONTACT_TOLERANCE", "FORMED_LIMIT", "GRADE", "TIE"]
