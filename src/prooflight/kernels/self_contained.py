"""Compilation of kernels to machine code that depends on their source alone, not on what else a process has loaded.

A kernel's machine code contains a copy of each compiled function that it calls and that was not inlined. Numba
gives these copies weak symbols: the copy that a process loads first serves all its kernels. The copies of a
function differ, because each was optimised as often as it was linked, and with ``fastmath`` they round
differently. Processes that compiled their kernels and processes that loaded them therefore computed different
results. The names of symbols only count the functions that a process has compiled, so that two functions from
two processes may also have the same name.

Here the copies are local: a kernel always calls its own.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import Linkage  # type: ignore[import-untyped]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class SelfContainedLibrary(JITCodeLibrary):
    """Machine code of one kernel, which calls its own copies of what was linked with it."""

    def _finalize_final_module(self) -> None:
        """Make the copies local after all optimisation, which must not treat them otherwise than numba does.

        The module that other kernels are linked with is stored before, as numba makes it.
        """
        self._shared_module = self._final_module.clone()
        _change(self._shared_module, Linkage.external, Linkage.linkonce_odr)
        _change(self._final_module, Linkage.linkonce_odr, Linkage.internal)
        super()._finalize_final_module()


class SelfContainedCompiler(Compiler):
    """Numba's compiler, with a ``SelfContainedLibrary`` for each kernel."""

    def _compile_core(self) -> Any:
        state = self.state
        state.library = SelfContainedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()  # so that it can be stored
        return super()._compile_core()


def _change(module: Any, linkage: Linkage, other: Linkage) -> None:
    """Change the linkage of the functions that a module defines."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == linkage:
            function.linkage = other
