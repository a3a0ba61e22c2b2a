"""How kernels see memory: plain pointers into buffers that the engine owns.

Arrays would do, but each view of one counts references atomically, which takes longer than a product with a small
matrix; a tuple of arrays is copied field by field into every function that is not inlined; and an index into an array
may be negative for all the compiler knows, which keeps loops from vectorising. So kernels take addresses as integers
in named tuples, and turn them into pointers, which Numba indexes like arrays. Nothing is checked: whoever owns the
buffers (`buffers`) keeps them alive and makes them large enough.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

lowered: Callable[[Callable[..., Any]], Callable[..., Any]] = intrinsic
"""`intrinsic`, for the eyes of a type checker: the typing context is no argument of the calls."""

LINE = 8
"""Doubles in a cache line, the length of the longest vector as well."""


def _pointer(dtype) -> Any:
    """An intrinsic that makes a pointer to element number `at` of the elements of `dtype` at an address."""

    @lowered
    def pointer(typingctx, address, at):
        del typingctx, address, at

        def generate(context, builder, signature, args):
            element = context.get_data_type(signature.return_type.dtype)
            return builder.gep(builder.inttoptr(args[0], element.as_pointer()), [args[1]])

        return types.CPointer(dtype)(types.intp, types.intp), generate

    return pointer


doubles = _pointer(types.float64)
integers = _pointer(types.int64)
complexes = _pointer(types.complex128)
booleans = _pointer(types.boolean)
int32s = _pointer(types.int32)
letters = _pointer(types.uint8)


@lowered
def start_of(typingctx, array):
    """Pointer to the first element of a C-contiguous array."""
    del typingctx

    def generate(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@lowered
def shift(typingctx, pointer, by):
    """Pointer to the element number `by` from the one pointed at."""
    del typingctx, by

    def generate(context, builder, signature, args):
        del context, signature
        return builder.gep(args[0], [args[1]])

    return pointer(pointer, types.intp), generate


@lowered
def bits_of(typingctx, number):
    """The bits of a float64 as an int64."""
    del typingctx, number

    def generate(context, builder, signature, args):
        del context, signature
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), generate


@lowered
def float_of(typingctx, bits):
    """The float64 of the bits of an int64."""
    del typingctx, bits

    def generate(context, builder, signature, args):
        del context, signature
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), generate


def whole_lines(size: int) -> int:
    """The size in doubles, rounded up to whole cache lines."""
    return -(-size // LINE) * LINE


def aligned(size: int) -> NDArray[np.float64]:
    """A vector `(size,)` of zeros that starts at a cache line: loads that straddle two lines take twice as long."""
    room = np.zeros(size + LINE)
    skip = (-room.ctypes.data // 8) % LINE
    return room[skip : skip + size]


def address(array: NDArray) -> int:
    """Address of the first element of a C-contiguous array, which must be kept alive.

    Raises:
        ValueError: the array is not contiguous.
    """
    if not array.flags.c_contiguous:
        raise ValueError("kernels read contiguous arrays only")
    return int(array.ctypes.data)
