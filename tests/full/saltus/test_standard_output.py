"""Long cases of tests/saltus/test_standard_output.py."""

import pytest

from tests.saltus.test_standard_output import (
    POSIX,
    QUICK,
    require_a_closed_standard_output_does_not_keep_files_from_being_written,
    require_names_that_are_no_text_are_printed_as_escapes,
    require_the_path_of_standard_output_is_standard_output,
)


@POSIX
@pytest.mark.parametrize(
    ("words", "files"),
    [
        (f"{QUICK} --json a.json --csv a.csv --save --catalogue a.sqlite", ["a.csv", "a.json", "a.sqlite"]),
        (f"{QUICK} --json -", []),
        (f"{QUICK} --save --catalogue a.sqlite", ["a.sqlite"]),
        ("run --impulse 0.5 --duration 3 --npz a.npz", ["a.npz"]),
        ("list --catalogue {catalogue}", []),
        ("list --catalogue {catalogue} --json a.json", ["a.json"]),
        ("", []),
    ],
)
def test_a_closed_standard_output_does_not_keep_files_from_being_written(tmp_path, catalogue, words, files):
    """Oracle: see `require_a_closed_standard_output_does_not_keep_files_from_being_written`."""
    require_a_closed_standard_output_does_not_keep_files_from_being_written(tmp_path, catalogue, words, files)


@POSIX
@pytest.mark.parametrize(
    ("words", "schema"),
    [(f"{QUICK} --json", 2), ("list --catalogue {catalogue} --json", 2), ("export points --catalogue {catalogue} --json", 1)],
)
def test_the_path_of_standard_output_is_standard_output(catalogue, words, schema):
    """Oracle: see `require_the_path_of_standard_output_is_standard_output`."""
    require_the_path_of_standard_output_is_standard_output(catalogue, words, schema)


@POSIX
@pytest.mark.parametrize(
    ("encoding", "words"),
    [
        ("ascii:strict", f"{QUICK} --json"),
        ("utf-8:surrogateescape", f"{QUICK} --save --catalogue"),
        ("utf-8:strict", "orbit S13+ --energy 0.3 --plot"),
    ],
)
def test_names_that_are_no_text_are_printed_as_escapes(tmp_path, encoding, words):
    """Oracle: see `require_names_that_are_no_text_are_printed_as_escapes`."""
    require_names_that_are_no_text_are_printed_as_escapes(tmp_path, encoding, words)
