"""The pages of docs/ whose commands take long: each command and snippet runs as it is printed. Other pages: tests/saltus/test_readme.py."""

import pytest

from tests.saltus.test_readme import LONG, ROOT, require_page


@pytest.mark.parametrize("page", LONG, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_runs(page, tmp_path, monkeypatch, capsys):
    """Oracle: see `require_page`."""
    require_page(page, tmp_path, monkeypatch, capsys)
