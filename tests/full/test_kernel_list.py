"""The list of the kernels that each command calls."""

from benchmarks.kernels import EXAMPLES, recorded
from saltus import compiling


def test_the_list_of_kernels_is_what_the_commands_call():
    """Oracle: the commands themselves, each group in a new process. A kernel with other arguments needs `python -m benchmarks kernels`."""
    listed = compiling._listed()
    kernels, commands = recorded()
    assert kernels == [call[1:] for call in listed["kernels"]]
    assert commands == listed["commands"]
    assert set(commands) == set(EXAMPLES)
