"""Bindings for the part of Aravis (libaravis-0.8) that line cameras need, by ctypes.

A virtual environment cannot see the system's PyGObject, and pip builds it only where compilers and headers
are; the shared library alone is one package of the system (decision 22). Every call states its types here
once.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from functools import cache
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

NAMES: Final = ("libaravis-0.8.so.0", "libaravis-0.8.0.dylib", "libaravis-0.8-0.dll")
"""File names on Linux, macOS and Windows."""
INSTALL: Final = "install Aravis: `apt install libaravis-0.8-0`, or `brew install aravis`"

POINTER = ctypes.c_void_p
TEXT = ctypes.c_char_p
SIZE_T = ctypes.c_size_t
BOOL = ctypes.c_int
UINT = ctypes.c_uint
UINT64 = ctypes.c_uint64


class AravisError(Exception):
    """An error reported by Aravis; users see the message that ``aravis`` makes of it."""


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", ctypes.c_int), ("message", TEXT))


class _GValue(ctypes.Structure):
    _fields_ = (("type", SIZE_T), ("data", UINT64 * 2))


class GSList(ctypes.Structure):
    """A singly linked list of GLib."""


GSList._fields_ = (("data", POINTER), ("next", ctypes.POINTER(GSList)))
_ERRORS = ctypes.POINTER(ctypes.POINTER(_GError))


@cache
def library() -> ctypes.CDLL:
    """Load Aravis; OSError: it is not installed."""
    for name in NAMES:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    path = ctypes.util.find_library("aravis-0.8")
    if path is None:
        raise OSError("libaravis-0.8 is not installed")
    return ctypes.CDLL(path)


@cache
def _function(name: str, result: Any, types: tuple[Any, ...]) -> Callable[..., Any]:
    # GLib and GObject come with Aravis: their symbols are found through its library.
    one = getattr(library(), name)
    one.restype, one.argtypes = result, types
    return one


def plainly(name: str, result: Any, types: tuple[Any, ...], *given: Any) -> Any:
    """Call a function that cannot fail."""
    return _function(name, result, types)(*given)


def called(name: str, result: Any, types: tuple[Any, ...], *given: Any) -> Any:
    """Call a function whose last argument receives an error; AravisError."""
    error = ctypes.POINTER(_GError)()
    returned = _function(name, result, (*types, _ERRORS))(*given, ctypes.byref(error))
    if error:
        message = (error.contents.message or b"").decode(errors="replace")
        plainly("g_error_free", None, (POINTER,), ctypes.cast(error, POINTER))
        raise AravisError(message)
    return returned


def text(value: bytes | None) -> str:
    """Decode a string of Aravis."""
    return (value or b"").decode(errors="replace")


def unref(instance: int | None) -> None:
    """Release a reference to an object."""
    if instance:
        plainly("g_object_unref", None, (POINTER,), instance)


def is_a(instance: int, kind: str) -> bool:
    """Return whether an object is of a type, by the name of the function that returns the type."""
    wanted = plainly(f"{kind}_get_type", SIZE_T, ())
    return bool(plainly("g_type_check_instance_is_a", BOOL, (POINTER, SIZE_T), instance, wanted))


def set_property(instance: int, name: str, value: int | float, *, kind: str) -> None:
    """Set a property of an object.

    kind: ``int``, ``double``, or the name of the function that returns an enumeration's type.
    """
    # 24 and 60 are the fundamental types of GObject, G_TYPE_INT and G_TYPE_DOUBLE.
    fundamental = {"int": 6 << 2, "double": 15 << 2}
    gvalue = _GValue()
    type_ = fundamental.get(kind) or plainly(f"{kind}_get_type", SIZE_T, ())
    plainly("g_value_init", POINTER, (POINTER, SIZE_T), ctypes.addressof(gvalue), type_)
    if kind == "double":
        plainly(
            "g_value_set_double", None, (POINTER, ctypes.c_double), ctypes.addressof(gvalue), float(value)
        )
    else:
        setter = "g_value_set_int" if kind == "int" else "g_value_set_enum"
        plainly(setter, None, (POINTER, ctypes.c_int), ctypes.addressof(gvalue), int(value))
    plainly(
        "g_object_set_property",
        None,
        (POINTER, TEXT, POINTER),
        instance,
        name.encode(),
        ctypes.addressof(gvalue),
    )
