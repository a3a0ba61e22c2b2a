"""The pointers of `memory` and the routines of `lapack` as plain Python, with checks, for `NUMBA_DISABLE_JIT=1`.

Kernels are then Python functions that a debugger steps through. An address remembers the array that it belongs to, so
a pointer knows where its buffer ends. Numbers are NumPy's scalars, which divide by zero as machine code does.
"""

import struct
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.linalg import lapack

Index = int | np.integer
Record = TypeVar("Record", bound=tuple)


class Address(int):
    """Address of a C-contiguous array, which it keeps alive.

    Attributes:
        array: what stands there.
        name: of the buffer, in error messages; see `label`.
    """

    array: NDArray
    name: str

    def __new__(cls, array: NDArray) -> "Address":
        """Return the address of an array; ValueError where it is not contiguous."""
        if not array.flags.c_contiguous:
            raise ValueError("kernels read contiguous arrays only")
        self = super().__new__(cls, array.ctypes.data)
        self.array, self.name = array, f"array {array.shape}"
        return self


def label(record: Record) -> Record:
    """Name the buffers of a named tuple, and of those inside it, after their fields (`Work.slopes`); returns it."""
    for field, value in record._asdict().items():  # pyright: ignore[reportAttributeAccessIssue]  # named tuples only
        if isinstance(value, Address):
            value.name = f"{type(record).__name__}.{field}"
        elif isinstance(value, tuple):
            label(value)
    return record


class Pointer:
    """A place in a buffer, indexed from there like an array.

    Args:
        elements: the whole buffer `(size,)`.
        offset: number of the element pointed at. It may lie outside, as long as nobody reads or writes there.
        name: of the buffer.

    Raises:
        IndexError: an element outside of the buffer is read or written.
    """

    __slots__ = ("_read", "elements", "name", "offset", "size")

    def __init__(self, elements: NDArray, offset: int, name: str) -> None:
        self.elements, self.offset, self.name, self.size = elements, int(offset), name, elements.size
        # Python's integers and truth values, as Numba returns them; NumPy's floats
        self._read = elements.__getitem__ if elements.dtype.kind in "fc" else elements.item

    def __repr__(self) -> str:
        return f"<{self.name} from element {self.offset} of {self.size} {self.elements.dtype}>"

    def _outside(self, i: Index) -> IndexError:
        at, kind = self.offset + i, self.elements.dtype
        return IndexError(
            f"{self.name}: no element {at} (offset {self.offset}, index {i}), its size is {self.size} {kind}"
        )

    def __getitem__(self, i: Index) -> Any:
        at = self.offset + i
        if not 0 <= at < self.size:
            raise self._outside(i)
        return self._read(at)

    def __setitem__(self, i: Index, value: Any) -> None:
        at = self.offset + i
        if not 0 <= at < self.size:
            raise self._outside(i)
        self.elements[at] = value


def _pointer(dtype: DTypeLike) -> Callable[[int, int], Pointer]:
    """Return a function that makes a pointer to element number `at` of the elements of `dtype` at an address."""
    wanted = np.dtype(dtype)

    def pointer(address: int, at: int) -> Pointer:
        if not isinstance(address, Address):
            raise TypeError(f"{address} is not the address of a buffer, but a number")
        array = address.array
        if array.dtype != wanted and not {array.dtype.kind, wanted.kind} <= {"f", "c"}:
            raise TypeError(f"{address.name} holds {array.dtype}, not {wanted}")
        return Pointer(array.reshape(-1).view(wanted), at, address.name)

    return pointer


doubles = _pointer(np.float64)
integers = _pointer(np.int64)
complexes = _pointer(np.complex128)
booleans = _pointer(np.bool_)
int32s = _pointer(np.int32)
letters = _pointer(np.uint8)


def start_of(array: NDArray) -> Pointer:
    """Pointer to the first element of a C-contiguous array."""
    return Pointer(Address(array).array.reshape(-1), 0, f"array {array.shape}")


def shift(pointer: Pointer, by: int) -> Pointer:
    """Pointer to the element number `by` from the one pointed at."""
    return Pointer(pointer.elements, pointer.offset + by, pointer.name)


def carray(pointer: Pointer, shape: tuple[int, ...]) -> NDArray:
    """Array of a shape on the elements from a pointer on; IndexError where they go beyond the buffer."""
    size = int(np.prod(shape))
    if size > 0:
        _ = pointer[0], pointer[size - 1]
    return pointer.elements[pointer.offset : pointer.offset + size].reshape(shape)


def bits_of(number: float) -> int:
    """Return the bits of a float64 as an int64."""
    return struct.unpack("<q", struct.pack("<d", number))[0]


def float_of(bits: int) -> np.float64:
    """Return the float64 of the lowest 64 bits of an integer: those above have overflowed."""
    return np.float64(struct.unpack("<d", struct.pack("<Q", bits & (2**64 - 1)))[0])


def dgeev(eigen: Any, vectors: bool) -> int:
    """`lapack.dgeev`, through SciPy."""
    n = eigen.n

    def at(address: int, *shape: int) -> NDArray:
        return carray(doubles(address, 0), shape)

    real, imag, covectors, right, info = lapack.dgeev(  # pyright: ignore[reportAttributeAccessIssue]  # of f2py
        at(eigen.a, n, n).T, compute_vl=vectors, compute_vr=vectors, lwork=eigen.space_size
    )
    at(eigen.real, n)[:], at(eigen.imag, n)[:] = real, imag
    if vectors:
        at(eigen.vectors, n, n)[:], at(eigen.covectors, n, n)[:] = covectors.T, right.T
    return int(info)


def dgebal(eigen: Any) -> int:
    """`lapack.dgebal`, through SciPy."""
    n, cluster = eigen.n, eigen.cluster
    balanced = carray(doubles(cluster.balanced, 0), (n, n))
    result, _, _, scale, info = lapack.dgebal(  # pyright: ignore[reportAttributeAccessIssue]  # of f2py
        balanced.T, scale=1, permute=0
    )
    balanced[:], carray(doubles(cluster.scale, 0), (n,))[:] = result.T, scale
    return int(info)


def zgesvd(eigen: Any) -> int:
    """`lapack.zgesvd`, through SciPy."""
    n, cluster = eigen.n, eigen.cluster
    shifted = carray(complexes(cluster.shifted, 0), (n, n))
    left, singular, right, info = lapack.zgesvd(shifted.T)  # pyright: ignore[reportAttributeAccessIssue]  # of f2py
    carray(doubles(cluster.singular, 0), (n,))[:] = singular
    carray(complexes(cluster.left, 0), (n, n))[:] = left.T
    carray(complexes(cluster.right, 0), (n, n))[:] = right.T
    return int(info)
