"""What is installed, and that it says so: packages, data, licence, dependencies, entry point."""

import configparser
import importlib
import re
import tomllib
from pathlib import Path

from setuptools import find_packages

import backend

ROOT = Path(__file__).parents[2]
CONFIGURATION = configparser.ConfigParser()
CONFIGURATION.read(ROOT / "setup.cfg", encoding="utf-8")


def listed(section, key):
    """Return the lines of a list in setup.cfg."""
    return CONFIGURATION[section][key].split("\n")[1:]


def test_all_code_is_installed_and_nothing_else():
    """Oracle: each folder with Python files, except tests and benchmarks, is a package that setup.cfg includes."""
    included = set(find_packages(str(ROOT), include=listed("options.packages.find", "include")))
    top = {"bvp", "continuation", "branches", "transitions", "saltus", "catalogues"}
    folders = {".".join(path.parent.relative_to(ROOT).parts) for name in top for path in (ROOT / name).rglob("*.py")}
    assert included == folders
    assert {name.partition(".")[0] for name in included} == top


def test_each_dependency_has_its_reason_in_the_readme_and_on_its_page():
    """Oracle: setup.cfg; for the installation pyproject.toml, and the most that the build backend adds."""
    lines = listed("options", "install_requires") + listed("options.extras_require", "test")
    lines += tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    lines += [*backend.TOOLS, "ziglang"]
    needed = {re.match(r"[a-z-]+", line).group() for line in lines}
    readme = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Dependencies")[2]
    page = (ROOT / "docs" / "reference" / "dependencies.md").read_text(encoding="utf-8")
    assert set(re.findall(r"(?:^- |; )([a-z-]+): \w", readme, re.MULTILINE)) == needed
    assert set(re.findall(r"^\| ([a-z-]+) \| .*\w.*\|$", page, re.MULTILINE)) - {"package"} == needed


def test_the_entry_point_exists():
    """Oracle: setup.cfg."""
    (line,) = listed("options.entry_points", "console_scripts")
    module, _, function = line.split(" = ")[1].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_the_licence_is_mit():
    """Oracle: its first line; setup.cfg."""
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith("MIT License\n")
    assert CONFIGURATION["metadata"]["license"] == "MIT"
