"""Mutants of a function or a module: its source with one sign turned at a time."""

import ast
import inspect
import textwrap


def signs(tree):
    """Places with a sign: sums, differences, and what is added to or taken away in place."""
    return [node for node in ast.walk(tree) if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub)]


def _turned(node):
    node.op = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()


def mutants(function, names):
    """(the mutated line, the mutated function) for each sign of a function, written for Python or compiled.

    Parameters
    ----------
    function : callable
    names : mapping
        What its source may name, beside its module's own; decorators leave it as it is.
    """
    plain = getattr(function, "function", function)
    source = textwrap.dedent(inspect.getsource(plain))
    count = len(signs(ast.parse(source)))
    for k in range(-1, count):
        tree = ast.parse(source)
        tree.body[0].decorator_list = []
        line = ""
        if k >= 0:
            node = signs(tree)[k]
            _turned(node)
            line = f"{plain.__name__}: {ast.unparse(node)}"
        ast.fix_missing_locations(tree)
        space = {**plain.__globals__, **names}
        exec(compile(tree, f"mutant {k} of {plain.__name__}", "exec"), space)
        yield line, space[plain.__name__]
