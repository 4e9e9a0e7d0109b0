"""The catalogue of the reference scene, built once for all tests of this folder."""

import json
import shutil
from pathlib import Path

import pytest

from saltus.__main__ import main
from tests.building import built_once


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """The catalogue's path, the report of its build, and the exit code."""

    def make(folder):
        code = main(["build", "--workers", "2", "--catalogue", str(folder / "lee2009.sqlite"), "--json", str(folder / "report.json")])
        return json.loads((folder / "report.json").read_text()), code

    folder, (report, code) = built_once(tmp_path_factory, "shipped", make)
    return Path(shutil.copy(folder / "lee2009.sqlite", tmp_path_factory.mktemp("own"))), report, code
