"""Long cases of tests/saltus/test_startup.py."""

from __future__ import annotations

from saltus import compiling
from saltus.__main__ import main
from tests.saltus import test_startup as origin

empty = origin.empty


def test_the_command_compiles_everything(empty, capsys):
    """Oracle: nothing is missing afterwards, and a second call says so."""
    assert main(["compile"]) == 0
    out, err = capsys.readouterr()
    assert "compiled 2 of 2 kernels" in out and "all kernels are compiled" in out and "compiling 2 kernels" in err
    assert compiling.missing() == []
    assert main(["compile"]) == 0
    assert capsys.readouterr() == ("all kernels are compiled: no command compiles any\n", "")


def test_a_kernel_that_cannot_be_compiled_is_named(empty, capsys):
    """Oracle: a kernel that does not exist."""
    empty["kernels"].append([0.1, "bvp.kernels.flight", "none_such", ["", "float"]])
    empty["commands"]["run"].append(2)
    assert main(["compile"]) == 1
    assert "not compiled: none_such of bvp.kernels.flight" in capsys.readouterr().out
