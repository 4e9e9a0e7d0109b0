"""Running a command in this process, and reading its files."""

import contextlib
import io
import json
import shlex

from saltus.__main__ import main


def run(capsys, *words):
    """Exit code, standard output, standard error."""
    code = main([str(word) for word in words])
    return (code, *capsys.readouterr())


def reported(words):
    """The same of a command line, without a fixture."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(shlex.split(words))
    return code, out.getvalue(), err.getvalue()


def read_json(path):
    """The content of a JSON file."""
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def read_branch(path):
    """The branch of a JSON file of responses that has one."""
    (branch,) = read_json(path)["branches"]
    return branch


def refused(result, *expected):
    """The line on standard error that refuses a command. The exit code is 2, standard output is empty, and the line has each part."""
    code, out, err = result
    assert code == 2, (code, err)
    assert out == "", "something was started"
    assert err.startswith("saltus: ") and len(err.splitlines()) == 1 and err.endswith("\n"), err
    for part in expected:
        assert part in err, err
    return err


def run_refused(capsys, *words):
    """The line that refuses a command."""
    return refused(run(capsys, *words))
