"""The catalogue of the reference scene, built once for all tests of this folder."""

import json

import pytest

from saltus.__main__ import main


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """The catalogue's path, the report of its build, and the exit code."""
    folder = tmp_path_factory.mktemp("shipped")
    code = main(["build", "--workers", "2", "--catalogue", str(folder / "lee2009.sqlite"), "--json", str(folder / "report.json")])
    return folder / "lee2009.sqlite", json.loads((folder / "report.json").read_text()), code
