"""Room for spectra and what their sensitivities need."""

import numpy as np

from eigenode_cli.engines.compiled.clusters import Cluster
from eigenode_cli.engines.compiled.debug_memory import label
from eigenode_cli.engines.compiled.lapack import DGEBAL, DGEEV, ZGESVD, dgeev_space, zgesvd_space
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.compiled.spectrum import Eigen


def build_eigen(owner: Owner, n: int, count: int, max_condition: float) -> Eigen:
    """Room for `count` spectra of n eigenvalues, and working space."""
    space, vectors = dgeev_space(n), 0 if n == 2 else count * n * n
    eigen = Eigen(
        n=n,
        max_condition=float(max_condition),
        spectra=owner.zeros(count * n, np.complex128),
        levels=owner.floats(count),
        capacity=count,
        forms=owner.floats(6, count if n == 2 else 0),
        left=owner.zeros(vectors, np.complex128),
        right_real=owner.floats(vectors),
        right_imag=owner.floats(vectors),
        a=owner.floats(n, n),
        real=owner.floats(n),
        imag=owner.floats(n),
        vectors=owner.floats(n, n),
        covectors=owner.floats(n, n),
        space_size=space,
        space=owner.floats(space),
        words=owner.zeros(4, np.int32),
        letter=owner.zeros(1, np.uint8),
        routine=int(DGEEV),
        cluster=_build_cluster(owner, n),
    )
    return label(eigen)


def _build_cluster(owner: Owner, n: int) -> Cluster:
    space = zgesvd_space(n)
    return Cluster(
        label=owner.zeros(n, np.int64),
        members=owner.zeros(n, np.int64),
        overlap=owner.zeros(n * n, np.complex128),
        balanced=owner.floats(n, n),
        scale=owner.floats(n),
        shifted=owner.zeros(n * n, np.complex128),
        left=owner.zeros(n * n, np.complex128),
        right=owner.zeros(n * n, np.complex128),
        singular=owner.floats(n),
        space_size=space,
        space=owner.zeros(space, np.complex128),
        real_space=owner.floats(5 * n),
        balance=int(DGEBAL),
        decompose=int(ZGESVD),
    )
