"""How kernels see memory: plain pointers into buffers that the engine owns.

Arrays would do, but each view of one counts references atomically, which takes longer than a product with a small
matrix; a tuple of arrays is copied field by field into every function that is not inlined; and an index into an array
may be negative for all the compiler knows, which keeps loops from vectorising. So kernels take addresses as integers
in named tuples, and turn them into pointers, which Numba indexes like arrays. Nothing is checked: whoever owns the
buffers (`buffers`) keeps them alive and makes them large enough. With `NUMBA_DISABLE_JIT=1` the same names are plain
Python that checks every access (`debug_memory`).

Numba has no pointer to an address in its public interface, so intrinsics build LLVM instructions here, with Numba
0.68.1 and llvmlite 0.50.0 tested. They rely on `context.get_data_type`, `context.make_array(...).data`, and LLVM types
that know what they point at (`as_pointer`); llvmlite leaves those for opaque pointers, then `gep` must be told the type
of the elements. Where any of it changes, the first kernel does not compile.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage]  # documented under these names
from numba.extending import intrinsic
from numpy.typing import NDArray

from eigenode_cli.engines.compiled import debug_memory
from eigenode_cli.jit import PLAIN

LINE = 8
"""Doubles in a cache line, the length of the longest vector as well."""


def _pointer(dtype) -> Any:
    """Return an intrinsic that makes a pointer to element number `at` of the elements of `dtype` at an address."""

    @intrinsic
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


def _start_of(typingctx, array):
    del typingctx

    def generate(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


start_of: Any = intrinsic(_start_of)
"""`start_of(array)`: pointer to the first element of a C-contiguous array."""


def _shift(typingctx, pointer, by):
    del typingctx, by

    def generate(context, builder, signature, args):
        del context, signature
        return builder.gep(args[0], [args[1]])

    return pointer(pointer, types.intp), generate


shift: Any = intrinsic(_shift)
"""`shift(pointer, by)`: pointer to the element number `by` from the one pointed at."""


def _bits_of(typingctx, number):
    del typingctx, number

    def generate(context, builder, signature, args):
        del context, signature
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), generate


bits_of: Any = intrinsic(_bits_of)
"""`bits_of(number)`: the bits of a float64 as an int64."""


def _float_of(typingctx, bits):
    del typingctx, bits

    def generate(context, builder, signature, args):
        del context, signature
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), generate


float_of: Any = intrinsic(_float_of)
"""`float_of(bits)`: the float64 of the bits of an int64."""


def whole_lines(size: int) -> int:
    """Return the size in doubles, rounded up to whole cache lines."""
    return -(-size // LINE) * LINE


def aligned(size: int) -> NDArray[np.float64]:
    """Return zeros `(size,)` that start at a cache line: loads that straddle two lines take twice as long."""
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


if PLAIN:
    doubles, integers, complexes = debug_memory.doubles, debug_memory.integers, debug_memory.complexes
    booleans, int32s, letters = debug_memory.booleans, debug_memory.int32s, debug_memory.letters
    start_of, shift, carray = debug_memory.start_of, debug_memory.shift, debug_memory.carray
    bits_of, float_of, address = debug_memory.bits_of, debug_memory.float_of, debug_memory.Address
