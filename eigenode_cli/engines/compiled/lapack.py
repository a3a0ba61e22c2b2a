"""LAPACK's `dgeev` from compiled code: eigenvalues, left and right eigenvectors of a real matrix, without Python."""

from llvmlite import ir
from numba import types
from numba.extending import get_cython_function_address
from scipy.linalg import lapack

from eigenode_cli.engines.compiled.memory import int32s, letters, lowered
from eigenode_cli.jit import njit

DGEEV: int = get_cython_function_address("scipy.linalg.cython_lapack", "dgeev")
"""Address of the routine, an argument of kernels: a constant of one process must not get into the disk cache."""

_ARGUMENTS = 14
_V, _N = ord("V"), ord("N")


@lowered
def _call(typingctx, address, pointers):
    """Call the routine at `address`, which takes 14 pointers and returns nothing, with a tuple of 14 addresses."""
    del typingctx, address
    if len(pointers) != _ARGUMENTS:
        raise TypeError(f"dgeev takes {_ARGUMENTS} arguments")

    def generate(context, builder, signature, args):
        del signature
        pointer = ir.IntType(8).as_pointer()
        routine = ir.FunctionType(ir.VoidType(), [pointer] * _ARGUMENTS)
        function = builder.inttoptr(args[0], routine.as_pointer())
        words = [builder.extract_value(args[1], i) for i in range(_ARGUMENTS)]
        builder.call(function, [builder.inttoptr(word, pointer) for word in words])
        return context.get_dummy_value()

    return types.none(types.intp, types.UniTuple(types.intp, _ARGUMENTS)), generate


def dgeev_space(n: int) -> int:
    """Doubles of working space at which `dgeev` is fastest for a matrix `(n, n)` with both sets of eigenvectors."""
    size, info = lapack.dgeev_lwork(n, compute_vl=1, compute_vr=1)
    if info != 0:
        raise RuntimeError(f"LAPACK's workspace query for n={n} failed with info={info}")
    return int(size.real)


@njit
def dgeev(eigen, vectors):
    """Eigenvalues of the Fortran matrix at `eigen.a`, and unit eigenvectors if `vectors`, into the fields of `eigen`.

    Vector i stands at `i n`; members of a pair are neighbours, the one with Im > 0 first, and real and imaginary part
    of its vector stand where the vectors of the two would. Returns LAPACK's info, 0 for success.
    """
    words, letter = int32s(eigen.words, 0), letters(eigen.letter, 0)
    words[0], words[1], words[2] = eigen.n, eigen.space_size, 0
    letter[0] = _V if vectors else _N
    n, info = eigen.words, eigen.words + 8
    matrix, values = (n, eigen.a, n), (eigen.real, eigen.imag)
    spaces = (eigen.vectors, n, eigen.covectors, n, eigen.space, eigen.words + 4)
    _call(eigen.routine, (eigen.letter, eigen.letter, *matrix, *values, *spaces, info))
    return words[2]
