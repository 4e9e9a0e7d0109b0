"""The fixtures of tests/saltus."""

from tests.saltus.conftest import catalogue, folder, quiet

__all__ = ["catalogue", "folder", "quiet"]
