"""Running a command in this process."""

from saltus.__main__ import main


def run(capsys, *words):
    """Exit code, standard output, standard error."""
    code = main([str(word) for word in words])
    return (code, *capsys.readouterr())
