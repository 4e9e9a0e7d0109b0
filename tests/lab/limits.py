"""Numbers at which the core changes its method, and names of what it returns."""

from saltus_core import COMMON_TESTS as COMMON
from saltus_core import FORMED_LIMIT, GRADE

from bvp.kernels.extrema import TIE
from bvp.kernels.impact import CONTACT_TOLERANCE

__all__ = ["COMMON", "CONTACT_TOLERANCE", "FORMED_LIMIT", "GRADE", "TIE"]
