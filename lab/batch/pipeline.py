"""How numba compiles a function that calls 300 others, which pass tuples of up to a thousand numbers.

As it comes, numba makes machine code of each function and moves only small ones into their callers: half of a
tick's time then goes into copies of tuples. Here a callee stays LLVM's intermediate code (PART), and in the
entry's (WHOLE) no function is visible from outside: LLVM then moves each that is called once into its caller.

These are numba's inner classes: `tests/unit/test_compiled.py` fails where another version has others.
"""

import os
from typing import Any

import llvmlite.binding as llvm
import numba.experimental.function_type  # its lowering of functions as values comes before ours  # noqa: F401
from numba import _dynfunc
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.imputils import lower_constant
from numba.core.typed_passes import NativeLowering

os.environ.setdefault("NUMBA_OPT", "1")  # a third less time to compile; dives are as fast


@lower_constant(types.Dispatcher)  # type: ignore[untyped-decorator]
def _type_alone(context: Any, builder: Any, kind: Any, function: Any) -> Any:
    """Let a function that is a value be its type alone: with an address nothing could stay on disk."""
    return context.get_dummy_value()


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """The intermediate code of a function that only compiled functions call."""

    def finalize(self) -> None:
        """Take in the code of the callees, and leave all further work to the caller."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True


class _Whole(JITCodeLibrary):  # type: ignore[misc]
    """The machine code of an entry."""

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = llvm.Linkage.internal
        super()._optimize_final_module()


@register_pass(mutates_CFG=True, analysis_only=False)
class _LoweredPart(NativeLowering):  # type: ignore[misc]
    _name = "lowered_part"

    def run_pass(self, state: Any) -> bool:
        library = state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        state.flags.no_compile = True
        super().run_pass(state)
        fndesc = state.cr.fndesc
        name = fndesc.qualname.rpartition(".")[2]
        function = _dynfunc.make_function(fndesc.lookup_module(), name, "", 0, state.cr.env, (library,))
        state.targetctx.insert_user_function(function, fndesc, [library])
        state.reload_init.extend(library._reload_init)
        state["cr"] = state.cr._replace(cfunc=function)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _LoweredWhole(NativeLowering):  # type: ignore[misc]
    _name = "lowered_whole"

    def run_pass(self, state: Any) -> bool:
        state.library = _Whole(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


def _compiler(lowering: type[NativeLowering]) -> type[CompilerBase]:
    """Return numba's compiler with another last step."""

    class Compiler(CompilerBase):  # type: ignore[misc]
        def define_pipelines(self) -> list[Any]:
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.passes = [
                (lowering if step is NativeLowering else step, why) for step, why in passes.passes
            ]
            passes._finalized = False
            passes.finalize()
            return [passes]

    return Compiler


PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _compiler(_LoweredPart)}
WHOLE = {"pipeline_class": _compiler(_LoweredWhole)}
