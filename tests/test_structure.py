"""The structure of the source: no import circles between files.

Oracle: the strongly connected components of the graph of imports (networkx). An import inside a function counts. An import for type hints
alone (`if TYPE_CHECKING`) does not: it never runs.
"""

import ast
import configparser
import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).parents[1]


def modules(root, packages):
    """Path of each module by its name."""
    files = [file for package in packages for file in (root / package).rglob("*.py")]
    return {".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): file for file in files}


def imported(tree, known):
    """Names of the known modules that a module imports."""
    for node in statements(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "an import is relative"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in known else node.module for name in inner]
        yield from (name for name in names if name in known)


def statements(node):
    """The statements inside a node, without those for type hints."""
    hints = node.body if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING") else []
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr) and child not in hints:
            yield child
            yield from statements(child)


def circles(root, packages):
    """Groups of modules that import each other."""
    known = modules(root, packages)
    graph = nx.DiGraph()
    for name, file in known.items():
        for other in imported(ast.parse(file.read_text(encoding="utf-8")), known):
            # Importing a module also runs the packages that it is in; those that the importing module is in run already.
            parts = other.split(".")
            packages_run = {".".join(parts[:k]) for k in range(1, len(parts))} & set(known)
            around = {package for package in packages_run if name == package or name.startswith(f"{package}.")}
            graph.add_edges_from((name, needed) for needed in {other, *packages_run - around} - {name})
    return [sorted(group) for group in nx.strongly_connected_components(graph) if len(group) > 1]


def installed_packages():
    settings = configparser.ConfigParser()
    settings.read(ROOT / "setup.cfg")
    named = settings["options.packages.find"]["include"].split()
    return [name for name in named if "." not in name]


def test_no_files_import_each_other():
    packages = installed_packages()
    assert len(modules(ROOT, packages)) > 100
    assert circles(ROOT, packages) == []


def test_a_circle_is_found_also_inside_functions_and_through_packages(tmp_path):
    (tmp_path / "pack" / "part").mkdir(parents=True)
    files = {
        "__init__": "",
        "a": "from pack.b import f",
        "b": "def f():\n    from pack import c\n    return c",
        "c": "import pack.a",
        "d": "from typing import TYPE_CHECKING\nfrom pack.e import g\n",
        "e": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pack.d import D\n",
        "f": "from pack.part.low import h",
        "part/__init__": "from pack.part.high import k",
        "part/low": "",
        "part/high": "from pack.f import h",
    }
    for name, text in files.items():
        (tmp_path / "pack" / f"{name}.py").write_text(text, encoding="utf-8")
    assert sorted(circles(tmp_path, ["pack"])) == [["pack.a", "pack.b", "pack.c"], ["pack.f", "pack.part", "pack.part.high"]]


OF_KERNELS = {
    "benchmarks": {"kernels"},
    "tests/benchmarks": {"test_before_now"},
    "tests/branches": {"test_free_criticality", "test_kernel_memory"},
    "tests/bvp": {"test_chosen", "test_hostile_chains", "test_kernel_cache", "test_lent"},
    "tests/core": {"test_control", "test_extrema", "test_next_impact", "test_smooth_flight", "test_steps"},
    "tests/full/bvp": {"test_kernel_cache"},
    "tests/saltus": {"test_bad_calls", "test_startup"},
    "tests/transitions": {"test_section"},
}
"""Tests and benchmarks of the kernels themselves: how they are compiled and kept, how much one call does, and signs turned in them; and
tests of the core that compare with kernels which other users still have."""


def test_tests_and_benchmarks_reach_the_numerical_core_through_the_lab():
    """Oracle: the imports of each file."""
    found = {}
    for file in sorted(file for folder in ("tests", "benchmarks") for file in (ROOT / folder).rglob("*.py")):
        place = file.relative_to(ROOT)
        if place.parts[:2] == ("tests", "lab"):
            continue
        imports = [node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.Import | ast.ImportFrom)]
        names = [f"{getattr(node, 'module', None) or ''}.{alias.name}" for node in imports for alias in node.names]
        if any("kernels" in name.split(".") and "benchmarks" not in name for name in names):
            found.setdefault(place.parent.as_posix(), set()).add(place.stem)
    assert found == OF_KERNELS


@pytest.mark.parametrize(
    ("loaded", "heavy"),
    [
        ("saltus; dir(saltus)", {"numpy", "scipy", "sympy", "numba", "argparse"}),
        ("bvp", {"numpy", "numba", "scipy"}),
        ("bvp.lagrangian, bvp.system, bvp.parameters", {"sympy", "llvmlite"}),
        ("continuation.run, continuation.generic, continuation.switching", {"scipy", "sympy", "matplotlib", "numba"}),
        ("branches.figures.single, branches.figures.atlas", {"matplotlib"}),
    ],
)
def test_what_a_package_does_not_load(loaded, heavy):
    """Oracle: the modules that a new process has loaded after the import."""
    code = f"import sys; import {loaded}; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "set()\n"
