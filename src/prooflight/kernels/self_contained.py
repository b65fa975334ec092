"""Compilation of kernels to machine code that depends on their source alone, not on what else a process has loaded.

A kernel's machine code contains a copy of each compiled function that it calls and that was not inlined. Numba
gives these copies weak symbols: the copy that a process loads first serves all its kernels. The copies of a
function differ, because each was optimised as often as it was linked, and with ``fastmath`` they round
differently. Processes that compiled their kernels and processes that loaded them therefore computed different
results. The names of symbols only count the functions that a process has compiled, so that two functions from
two processes may also have the same name.

Here the copies are local: a kernel always calls its own.

Results did not depend on the values in arrays alone either, but on where the arrays lie. LLVM computes several
elements of a loop at once, unless an array that is written begins up to 256 bytes behind one that is read: they might
overlap. It then computes one element after the other, which rounds differently with ``fastmath``. Short arrays lie so
close by chance, depending on what a process has allocated before. Here only arrays that begin at one address count as
overlapping.
"""

from __future__ import annotations

import re
from typing import Any, Final

from llvmlite.binding import Linkage, parse_assembly, parse_bitcode  # type: ignore[import-untyped]
from numba import _dynfunc
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

VALUE: Final = r'%(?:"[^"]*"|[-\w$.]+)'
NEAR: Final = re.compile(rf"(%diff\.check[\w.]* =) icmp ult i64 ({VALUE}), \d+")
"""LLVM's test whether an array begins shortly behind another."""
OTHER_SOURCES: Final = {"load", "call", "extractvalue"}
"""Instructions whose result is not computed from the integers that they are given."""


class SelfContainedLibrary(JITCodeLibrary):
    """Machine code of one kernel, which calls its own copies of what was linked with it."""

    _final_module: Any

    def _finalize_final_module(self) -> None:
        """Make the copies local after all optimisation, which must not treat them otherwise than numba does.

        The module that other kernels are linked with is stored before, as numba makes it.
        """
        self._shared_module = self._final_module.clone()
        _change(self._shared_module, Linkage.external, Linkage.linkonce_odr)
        text = str(self._final_module)
        if NEAR.search(text):
            name = self._final_module.name
            self._final_module = parse_assembly(wherever_arrays_lie(text))
            self._final_module.name = name
        _change(self._final_module, Linkage.linkonce_odr, Linkage.internal)
        super()._finalize_final_module()


class InnerLibrary(JITCodeLibrary):
    """Optimised code of a loop that only kernels call, which get a copy each; no machine code is made of it."""

    _final_module: Any

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return what the cache stores, which is bitcode here."""
        return self.name, "bitcode", self._get_module_for_linking().as_bitcode()


class StoredLibrary(JITCodeLibrary):
    """Machine code of one kernel from the cache.

    The bitcode that is stored with it is parsed only where a kernel that calls this one is compiled: parsing it takes
    as long as loading the machine code, and listing its symbols, as numba does, several times as long.
    """

    _shared_module: Any
    _bitcode = b""

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, Any]) -> JITCodeLibrary:
        name, kind, data = state
        if kind != "object":
            library: JITCodeLibrary = super()._unserialize(codegen, state)
            return library
        self = cls(codegen, name)
        machine_code, self._bitcode = data
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        return self

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._bitcode:
            self._shared_module = parse_bitcode(self._bitcode)
        return super()._get_module_for_linking()


class StoredKernel(CompileResultCacheImpl):
    """Numba's form of a kernel in the cache, loaded as a ``StoredLibrary``."""

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """Return a kernel as numba needs it; only one thread of a process does so at a time."""
        codegen, (library, described, *_) = target_context.codegen(), payload
        if library[1] == "object":
            # Numba asks the engine only for symbols of this set, since an unknown one would end the process.
            codegen._engine._defined_symbols.add(described.llvm_cpython_wrapper_name)  # noqa: SLF001
        usual, codegen._library_class = codegen._library_class, StoredLibrary  # noqa: SLF001
        try:
            return super().rebuild(target_context, payload)
        finally:
            codegen._library_class = usual  # noqa: SLF001


class SelfContainedCompiler(Compiler):
    """Numba's compiler, with a ``SelfContainedLibrary`` for each kernel."""

    library_class: type[JITCodeLibrary] = SelfContainedLibrary

    def _compile_core(self) -> Any:
        state = self.state
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()  # so that it can be stored
        return super()._compile_core()


class InnerCompiler(SelfContainedCompiler):
    """Numba's compiler, with an ``InnerLibrary`` for each loop that only kernels call.

    Machine code of these loops would never run, and took a twentieth of the time of compiling. A loop that is loaded
    from the cache, because a kernel that calls it has changed, is given machine code by numba.
    """

    library_class = InnerLibrary

    def _compile_core(self) -> Any:
        state = self.state
        state.flags.no_compile = True
        result = super()._compile_core()
        # Numba finds a loop's code by the function that Python would call, whose address is none here.
        name = result.fndesc.qualname.split(".")[-1]
        entry = _dynfunc.make_function(
            result.fndesc.lookup_module(), name, "", 0, result.environment, (result.library,)
        )
        state.targetctx.insert_user_function(entry, result.fndesc, [result.library])
        return result._replace(entry_point=entry)


def wherever_arrays_lie(text: str) -> str:
    """Return optimised loops, as LLVM's text, in which arrays overlap only if they begin at one address.

    They must not overlap otherwise. Distances within one array depend on its shape alone, and their tests remain.
    """
    return "".join(map(_wherever_arrays_lie, re.split(r"^(?=define )", text, flags=re.MULTILINE)))


def _wherever_arrays_lie(function: str) -> str:
    instructions: dict[str, str] = dict(re.findall(rf"^\s*({VALUE}) = (.*)$", function, flags=re.MULTILINE))

    def same(near: re.Match[str]) -> str:
        return f"{near[1]} icmp eq i64 {near[2]}, 0" if _is_of_addresses(near[2], instructions) else near[0]

    return NEAR.sub(same, function)


def _is_of_addresses(value: str, instructions: dict[str, str]) -> bool:
    """Return whether an integer is computed from addresses; instructions: by the values that they give."""
    waiting, seen = {value}, set[str]()
    while waiting:
        one = waiting.pop()
        seen.add(one)
        instruction = instructions.get(one, "")
        operation = instruction.partition(" ")[0]
        if operation == "ptrtoint":
            return True
        if operation not in OTHER_SOURCES:
            waiting |= set(re.findall(VALUE, instruction)) - seen
    return False


def _change(module: Any, linkage: Linkage, other: Linkage) -> None:
    """Change the linkage of the functions that a module defines."""
    for function in module.functions:
        if not function.is_declaration and function.linkage == linkage:
            function.linkage = other
