"""Long cases of tests/saltus/test_command_line.py."""

import pytest

from tests.saltus.test_command_line import require_pictures


@pytest.mark.parametrize(("suffix", "magic"), [("png", b"\x89PNG"), ("PDF", b"%PDF")])
def test_pictures(capsys, tmp_path, suffix, magic):
    """Oracle: see `require_pictures`."""
    require_pictures(capsys, tmp_path, suffix, magic)
