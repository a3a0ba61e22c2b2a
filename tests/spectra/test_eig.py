"""Eigenvalue and eigenvector derivatives, each by itself, against mathematics, finite differences and torch."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ortho_group
from torch import Tensor
from torch.autograd import forward_ad, gradcheck, gradgradcheck
from torch.func import hessian, jacfwd, jacrev, jvp, vmap

from eigenode_cli.spectra.eig import FROZEN_RATIO, eig, eigvals

SIZES = range(1, 13)
DTYPES = [torch.float64, torch.complex128]


def random_matrix(n: int, dtype: torch.dtype, seed: int = 0, *batch: int) -> Tensor:
    return torch.randn(*batch, n, n, dtype=dtype, generator=torch.Generator().manual_seed(100 * n + seed))


def non_normal(n: int, dtype: torch.dtype) -> Tensor:
    """Distinct eigenvalues with a large strictly upper part: condition numbers far from 1."""
    upper = torch.triu(random_matrix(n, dtype, 7), diagonal=1) * 2.0
    basis = torch.from_numpy(ortho_group.rvs(n, random_state=n)) if n > 1 else torch.ones(1, 1, dtype=torch.float64)
    basis = basis.to(dtype)
    return basis @ (upper + torch.diag(torch.arange(1.0, n + 1.0, dtype=torch.float64)).to(dtype)) @ basis.mH


def defective(n: int) -> Tensor:
    return torch.diag(torch.ones(n - 1, dtype=torch.float64), 1)


def outputs(matrix: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    system = eig(matrix)
    return system.eigenvalues, system.eigenvectors, system.left


def central_difference(matrix: Tensor, direction: Tensor) -> tuple[Tensor, ...]:
    """Fourth order; the step is a fixed part of the way to the nearest merge, about gap / condition away."""
    values = eigvals(matrix)[0]
    gaps = (values[:, None] - values[None, :]).abs() + 10.0 * torch.eye(values.numel(), dtype=torch.float64)
    h = 3e-3 * float(gaps.min() / eigenvalue_conditions(matrix).max() / direction.norm())
    at = {k: in_order_of(values, matrix + k * h * direction) for k in (-2, -1, 1, 2)}
    return tuple((8.0 * (at[1][i] - at[-1][i]) - (at[2][i] - at[-2][i])) / (12.0 * h) for i in range(3))


def in_order_of(values: Tensor, matrix: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """LAPACK's order is not continuous in A: each eigenvalue is the one nearest to that of `values`."""
    found, vectors, left = outputs(matrix)
    nearest = (found[None, :] - values[:, None]).abs().argmin(1)
    return found[nearest], vectors[:, nearest], left[:, nearest]


def eigenvalue_conditions(matrix: Tensor) -> Tensor:
    system = eig(matrix)
    return 1.0 / (system.left.conj() * system.eigenvectors).sum(-2).abs()


def assert_close(actual: Tensor, expected: Tensor, rtol: float) -> None:
    """Relative to the largest modulus of the whole."""
    torch.testing.assert_close(actual, expected, rtol=0.0, atol=rtol * max(1.0, float(expected.abs().max())))


# ---- values, gauge, order -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", SIZES)
def test_eigensystem_solves_both_eigenvalue_problems(n, dtype):
    matrix = random_matrix(n, dtype, 1, 3)
    values, vectors, left, guarded = eig(matrix)
    full = matrix.to(torch.complex128)
    torch.testing.assert_close(full @ vectors, vectors * values[..., None, :], rtol=0, atol=1e-13 * n)
    torch.testing.assert_close(full.mH @ left, left * values.conj()[..., None, :], rtol=0, atol=1e-13 * n)
    assert guarded.tolist() == [0, 0, 0]


@pytest.mark.parametrize("dtype", DTYPES)
def test_gauge_is_unit_norm_and_a_real_positive_frozen_component(dtype):
    system = eig(random_matrix(6, dtype, 2, 20))
    for vectors in (system.eigenvectors, system.left):
        torch.testing.assert_close(vectors.norm(dim=-2), torch.ones(20, 6, dtype=torch.float64), rtol=0, atol=1e-14)
        size = vectors.abs()
        frozen = (size >= FROZEN_RATIO * size.amax(-2, keepdim=True)).to(torch.uint8).argmax(-2, keepdim=True)
        component = torch.gather(vectors, -2, frozen)
        assert (component.imag == 0.0).all()
        assert (component.real > 0.0).all()


def test_gauge_is_stable_where_components_tie():
    """(1, +-i) / sqrt(2): rounding decides which component is the largest, and must not decide the phase."""
    rotation = torch.tensor([[0.0, 1.0], [-1.0, 0.0]], dtype=torch.float64)
    for seed in range(20):
        shaken = rotation + 1e-12 * random_matrix(2, torch.float64, seed)
        torch.testing.assert_close(eig(shaken).eigenvectors, eig(rotation).eigenvectors, rtol=0, atol=1e-11)


@pytest.mark.parametrize("n", [2, 3, 7, 12])
def test_pairs_of_real_matrices_are_exact_conjugates(n):
    system = eig(random_matrix(n, torch.float64, 3, 30))
    pairs = 0
    for values, *sides in zip(system.eigenvalues, system.eigenvectors, system.left, strict=True):
        for i in np.flatnonzero(values.imag.numpy() > 0.0):
            assert values[i + 1] == values[i].conj()
            for vectors in sides:
                assert torch.equal(vectors[:, i + 1], vectors[:, i].conj())
            pairs += 1
    assert pairs > 0


def test_single_precision_is_promoted_and_the_gradient_comes_back_in_it():
    matrix = random_matrix(3, torch.float64).float().requires_grad_()
    values, _ = eigvals(matrix)
    assert values.dtype == torch.complex128
    (gradient,) = torch.autograd.grad(values.real.pow(2).sum(), matrix)
    assert gradient.dtype == torch.float32
    double = matrix.detach().double().requires_grad_()
    (expected,) = torch.autograd.grad(eigvals(double)[0].real.pow(2).sum(), double)
    torch.testing.assert_close(gradient, expected.float())


@pytest.mark.parametrize("shape", [(0, 3, 3), (2, 0, 1, 1), (2, 3, 4, 4), (4, 4), (1, 1)])
def test_any_batch_is_its_single_matrices(shape):
    matrix = torch.randn(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(5)).requires_grad_()
    system = eig(matrix)
    assert system.eigenvalues.shape == shape[:-1]
    assert system.eigenvectors.shape == system.left.shape == shape
    assert system.guarded.shape == shape[:-2]
    (gradient,) = torch.autograd.grad((system.eigenvalues.abs() ** 2).sum() + system.eigenvectors.real.sum(), matrix)
    n = shape[-1]
    rows = zip(
        matrix.detach().reshape(-1, n, n),
        system.eigenvalues.reshape(-1, n),
        system.eigenvectors.reshape(-1, n, n),
        gradient.reshape(-1, n, n),
        strict=True,
    )
    for one, values, vectors, slope in rows:
        one.requires_grad_()
        single = eig(one)
        assert torch.equal(single.eigenvalues, values)
        assert torch.equal(single.eigenvectors, vectors)
        (expected,) = torch.autograd.grad((single.eigenvalues.abs() ** 2).sum() + single.eigenvectors.real.sum(), one)
        torch.testing.assert_close(slope, expected, rtol=1e-12, atol=1e-12)


def test_transposed_conjugated_and_negated_views_are_read_as_they_look():
    matrix = random_matrix(4, torch.complex128, 4, 2)
    negated = matrix.conj().imag
    assert negated.is_neg()
    for view in (matrix.mT, matrix.mH, matrix.conj(), matrix[..., ::2, ::2], negated, negated.mT):
        assert torch.equal(eig(view).eigenvalues, eig(view.clone().contiguous()).eigenvalues)
        assert torch.equal(eigvals(view)[0], eigvals(view.clone().contiguous())[0])
    leaf = matrix.clone().requires_grad_()
    (slope,) = torch.autograd.grad(eigvals(leaf.conj().imag)[0].abs().pow(2).sum(), leaf)
    (expected,) = torch.autograd.grad(torch.linalg.eigvals(leaf.conj().imag).abs().pow(2).sum(), leaf)
    torch.testing.assert_close(slope, expected)


@pytest.mark.parametrize("scale", [1e-310, 1e-200, 1e-140, 1e140, 1e200, 1e300])
def test_very_large_and_very_small_matrices(scale):
    """LAPACK's own scaling of such matrices is broken in some builds; the result must not depend on it."""
    for dtype in DTYPES:
        matrix = torch.tensor([[1.0, 2.0], [3.0, 4.0]], dtype=dtype) * scale
        expected = np.sort(np.linalg.eigvals([[1.0, 2.0], [3.0, 4.0]]))
        np.testing.assert_allclose(np.sort(eig(matrix).eigenvalues.real.numpy() / scale), expected, rtol=1e-9)


# ---- derivatives: each by itself -----------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [random_matrix, non_normal])
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", SIZES)
def test_each_derivative_is_the_finite_difference_forward_and_reverse(n, dtype, make):
    matrix, direction = make(n, dtype), random_matrix(n, dtype, 9)
    _, tangents = jvp(outputs, (matrix,), (direction,))
    for tangent, difference in zip(tangents, central_difference(matrix, direction), strict=True):
        assert_close(tangent, difference, 2e-8)
    # reverse: the whole Jacobian of every single output, contracted with the same direction
    leaf = matrix.clone().requires_grad_()
    for output, tangent in zip(outputs(leaf), tangents, strict=True):
        for entry, slope in zip(output.flatten(), tangent.flatten(), strict=True):
            for part, expected in ((entry.real, slope.real), (entry.imag, slope.imag)):
                (row,) = torch.autograd.grad(part, leaf, retain_graph=True)
                found = (row.conj() * direction).sum().real
                assert abs(found - expected) <= 1e-11 * max(1.0, float(tangent.abs().max()))


@pytest.mark.parametrize("n", SIZES)
def test_eigenvalues_of_a_real_matrix_by_complex_step(n):
    """An eigenvalue is analytic in A: with A + ih dA, `Im(lambda) / h` is the derivative of a real one to round-off."""
    basis = non_normal(n, torch.float64)
    matrix = torch.linalg.solve(basis, torch.diag(torch.arange(1.0, n + 1.0, dtype=torch.float64)) @ basis)
    direction = random_matrix(n, torch.float64, 11)
    values, tangent = jvp(lambda A: eigvals(A)[0], (matrix,), (direction,))
    assert (values.imag == 0.0).all()
    h = 1e-9
    stepped = eigvals(torch.complex(matrix, h * direction))[0]
    nearest = (stepped[None, :].real - values[:, None].real).abs().argmin(1)
    scale = float(tangent.abs().max() * eigenvalue_conditions(matrix).max())
    torch.testing.assert_close(stepped[nearest].imag / h, tangent.real, rtol=0, atol=1e-6 * max(1.0, scale))
    assert (tangent.imag.abs() <= 1e-12 * max(1.0, scale)).all()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_gradcheck_in_both_modes_batched_too(n, dtype):
    matrix = random_matrix(n, dtype, 12, 2).requires_grad_()
    options = {"check_forward_ad": True, "check_batched_grad": True, "check_batched_forward_grad": True}
    assert gradcheck(outputs, (matrix,), **options)
    assert gradcheck(lambda A: eigvals(A)[0], (matrix,), **options)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_second_derivatives(n, dtype):
    matrix = random_matrix(n, dtype, 13).requires_grad_()
    assert gradgradcheck(lambda A: eigvals(A)[0], (matrix,))
    assert gradgradcheck(outputs, (matrix,), check_fwd_over_rev=True)


def test_second_derivatives_through_function_transforms():
    matrix = random_matrix(3, torch.float64, 14, 2)

    def loss(of):
        return lambda A: of(A)[0].abs().pow(2).sum()

    expected = vmap(jacrev(jacrev(loss(eig))))(matrix)
    torch.testing.assert_close(vmap(hessian(loss(eig)))(matrix), expected)
    torch.testing.assert_close(vmap(jacrev(jacrev(loss(eigvals))))(matrix), expected)
    torch.testing.assert_close(vmap(jacrev(jacfwd(loss(eigvals))))(matrix), expected)
    torch.testing.assert_close(vmap(hessian(loss(eigvals)))(matrix), expected)
    for of in (eig, eigvals):
        torch.testing.assert_close(vmap(jacfwd(jacfwd(loss(of))))(matrix), expected)


def test_forward_over_forward_over_forward():
    """lambda = sqrt(q) of [[0, 1], [q, 0]] has the third derivative 3/8 q^(-5/2)."""

    def matrix(q: Tensor) -> Tensor:
        return torch.stack([torch.stack([0.0 * q, 1.0 + 0.0 * q]), torch.stack([q, 0.0 * q])])

    q = torch.tensor(2.0, dtype=torch.float64)
    for of in (eig, eigvals):
        third = jacfwd(jacfwd(jacfwd(lambda q, of=of: of(matrix(q))[0].real.max())))(q)
        assert float(third) == pytest.approx(0.375 * 2.0**-2.5, rel=1e-12)
    # the eigenvector is (1, sqrt(q)) / sqrt(1 + q), so that the square of its first component is 1 / (1 + q)
    second = jacfwd(jacfwd(lambda q: eig(matrix(q)).eigenvectors[0, 0].abs() ** 2))(q)
    assert float(second) == pytest.approx(2.0 / 27.0, rel=1e-12)


@pytest.mark.parametrize("dtype", DTYPES)
def test_function_transforms_agree(dtype):
    matrix = random_matrix(4, dtype, 15, 5)
    if dtype == torch.float64:
        for part in range(3):
            forward = vmap(jacfwd(lambda A, part=part: torch.view_as_real(outputs(A)[part])))(matrix)
            reverse = vmap(jacrev(lambda A, part=part: torch.view_as_real(outputs(A)[part])))(matrix)
            torch.testing.assert_close(forward, reverse, rtol=1e-10, atol=1e-10)
    looped = torch.stack([eigvals(A)[0] for A in matrix])
    assert torch.equal(vmap(lambda A: eigvals(A)[0])(matrix), looped)
    assert torch.equal(vmap(lambda A: eigvals(A)[0], in_dims=-1)(matrix.movedim(0, -1)), looped)
    assert torch.equal(vmap(vmap(lambda A: eig(A).guarded))(matrix[None]), torch.zeros(1, 5, dtype=torch.int64))


def test_forward_mode_of_autograd_is_that_of_function_transforms():
    matrix, direction = random_matrix(5, torch.float64, 16), random_matrix(5, torch.float64, 17)
    with forward_ad.dual_level():
        dual = forward_ad.unpack_dual(eigvals(forward_ad.make_dual(matrix, direction))[0])
        tangent = dual.tangent.clone()
    torch.testing.assert_close(tangent, jvp(lambda A: eigvals(A)[0], (matrix,), (direction,))[1])


def test_eigenvalues_alone_have_the_derivatives_of_the_full_system():
    matrix = random_matrix(6, torch.float64, 18, 3).requires_grad_()
    weight = torch.randn(3, 6, dtype=torch.complex128, generator=torch.Generator().manual_seed(1))
    slopes = [torch.autograd.grad((f(matrix)[0] * weight).sum().real, matrix)[0] for f in (eig, eigvals)]
    assert torch.equal(*slopes)


# ---- oracles and invariances ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", [2, 3, 5, 8, 12])
def test_torch_linalg_eig_agrees_on_losses_without_phase(n, dtype):
    """Sorted by real part and modulus, for torch's solver may order differently."""
    probe = random_matrix(n, dtype, 19)

    def loss(values: Tensor, vectors: Tensor) -> Tensor:
        order = torch.argsort(values.detach().real + 0.1 * values.detach().imag)
        values, vectors = values[order], vectors[:, order]
        ramp = torch.arange(1.0, n + 1.0, dtype=torch.float64)
        projections = (vectors.abs() ** 2 * probe.abs()).sum(0)
        return (ramp * (values.real + values.imag.sin())).sum() + (ramp * projections).sum()

    mine, theirs = (random_matrix(n, dtype, 20).requires_grad_() for _ in range(2))
    (slope,) = torch.autograd.grad(loss(*eig(mine)[:2]), mine)
    (expected,) = torch.autograd.grad(loss(*torch.linalg.eig(theirs)), theirs)
    torch.testing.assert_close(slope, expected, rtol=1e-9, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(2, 6), seed=st.integers(0, 10_000))
def test_similarity_leaves_eigenvalues_and_transforms_gradients(n, seed):
    """With B = T A T^-1 and a loss of the eigenvalues, `dL/dA = T^T dL/dB T^-T`; permutations are one such T."""
    generator = np.random.default_rng(seed)
    transforms = (ortho_group.rvs(n, random_state=seed), np.eye(n)[generator.permutation(n)])
    matrix = torch.from_numpy(generator.standard_normal((n, n))).requires_grad_()

    def loss(A: Tensor) -> Tensor:
        values = eigvals(A)[0]
        return (values.real.exp() + values.imag**2).sum()

    value = loss(matrix)
    (slope,) = torch.autograd.grad(value, matrix)
    for transform in map(torch.from_numpy, transforms):
        other = (transform @ matrix.detach() @ transform.T).requires_grad_()
        other_value = loss(other)
        (other_slope,) = torch.autograd.grad(other_value, other)
        assert_close(other_value.detach(), value.detach(), 1e-10)
        assert_close(transform.T @ other_slope @ transform, slope, 1e-6)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(1, 8), seed=st.integers(0, 10_000))
def test_trace_determinant_and_scale(n, seed):
    """sum lambda = tr A, prod lambda = det A, and lambda is homogeneous of degree one in A (Euler)."""
    matrix = torch.from_numpy(np.random.default_rng(seed).standard_normal((n, n))).requires_grad_()
    values = eigvals(matrix)[0]
    (of_sum,) = torch.autograd.grad(values.sum().real, matrix, retain_graph=True)
    assert_close(of_sum, torch.eye(n, dtype=torch.float64), 1e-7)
    (of_product,) = torch.autograd.grad(values.prod().real, matrix)
    (expected,) = torch.autograd.grad(torch.linalg.det(matrix), matrix)
    assert_close(of_product, expected, 1e-7)
    homogeneous = jvp(lambda A: eigvals(A)[0], (matrix.detach(),), (matrix.detach(),))[1]
    assert_close(homogeneous, values.detach(), 1e-7)


# ---- near and at the merge of eigenvalues --------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_known_slopes_near_the_merge_of_a_pair(distance, side):
    """[[0, 1], [q, -2]] has lambda = -1 +- sqrt(1 + q), so dlambda/dq = +-1 / (2 sqrt(1 + q)): 5, 50, 500, 5000."""
    q = torch.tensor(side * distance - 1.0, dtype=torch.float64, requires_grad=True)
    matrix = torch.stack([torch.tensor([0.0, 1.0], dtype=torch.float64), torch.stack([q, torch.full_like(q, -2.0)])])
    values, guarded = eigvals(matrix)
    spread = values.real if side > 0.0 else values.imag
    gap = spread.max() - spread.min()
    (slope,) = torch.autograd.grad(gap, q)
    excess = abs(1.0 + q.item())  # the distance as rounded
    assert guarded.item() == 0
    assert gap.item() == pytest.approx(2.0 * excess**0.5, rel=1e-7)
    assert float(slope) == pytest.approx(side / excess**0.5, rel=1e-7)


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_guard_bounds_the_slope_near_the_merge_and_counts(distance):
    matrix = torch.tensor([[0.0, 1.0], [distance - 1.0, -2.0]], dtype=torch.float64, requires_grad=True)
    limit = 200.0
    fires = bool((eigenvalue_conditions(matrix.detach()) > limit).all())
    values, guarded = eigvals(matrix, max_condition=limit)
    assert fires == (distance < 1e-4)
    assert guarded.item() == (2 if fires else 0)
    for i in range(2):
        (slope,) = torch.autograd.grad(values[i].real, matrix, retain_graph=True)
        assert torch.linalg.matrix_norm(slope, 2) <= limit * (1.0 + 1e-12)
        if fires:  # direction kept, size exactly at the limit
            (free,) = torch.autograd.grad(eigvals(matrix, max_condition=1e12)[0][i].real, matrix)
            torch.testing.assert_close(slope / slope.norm(), free / free.norm(), rtol=0, atol=1e-6)
            assert float(torch.linalg.matrix_norm(slope, 2)) == pytest.approx(limit, rel=1e-9)


DEGENERATE = {
    **{f"jordan{n}": (defective(n), n, n * (n - 1) // 2) for n in range(2, 7)},
    **{f"stable_jordan{n}": (defective(n) - torch.eye(n), n, n * (n - 1) // 2) for n in range(2, 7)},
    "critical_damping": (torch.tensor([[0.0, 1.0], [-1.0, -2.0]], dtype=torch.float64), 2, 1),
    "identity": (torch.eye(4, dtype=torch.float64), 0, 6),
    "zero": (torch.zeros(3, 3, dtype=torch.float64), 0, 3),
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("matrix", "weak", "close"), DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_matrices_have_bounded_derivatives_and_are_counted(matrix, weak, close, dtype):
    limit = 1e5
    matrix = matrix.to(dtype).requires_grad_()
    values, guarded = eigvals(matrix, max_condition=limit)
    system = eig(matrix, max_condition=limit)
    assert guarded.item() == weak
    assert system.guarded.item() == weak + close
    for value in values:
        (slope,) = torch.autograd.grad(value.real, matrix, retain_graph=True)
        assert torch.isfinite(slope.abs()).all()
        assert torch.linalg.matrix_norm(slope, 2) <= limit * (1.0 + 1e-9)
    (slope,) = torch.autograd.grad(system.eigenvectors.real.sum() + system.eigenvectors.imag.sum(), matrix)
    # P is at most limit, F at most limit / size
    assert slope.abs().max() <= 10.0 * limit**2
    _, tangents = jvp(lambda A: eig(A, limit)[:3], (matrix.detach(),), (torch.ones_like(matrix),))
    assert all(torch.isfinite(tangent.abs()).all() for tangent in tangents)


@pytest.mark.parametrize("n", range(2, 7))
def test_transformed_jordan_blocks_have_bounded_derivatives(n):
    """Rounding splits them by about eps^(1/n), so that nothing is exactly degenerate."""
    limit = 1e5
    basis = torch.from_numpy(ortho_group.rvs(n, random_state=n))
    matrix = (basis @ defective(n) @ basis.T).requires_grad_()
    values, guarded = eigvals(matrix, max_condition=limit)
    assert guarded.item() == n
    for value in values:
        real, imag = (torch.autograd.grad(part, matrix, retain_graph=True)[0] for part in (value.real, value.imag))
        slope = torch.complex(real, imag)
        in_best_units, as_is = float(slope.diagonal().abs().sum()), float(torch.linalg.matrix_norm(slope))
        assert in_best_units <= limit * (1.0 + 1e-9)
        assert limit == pytest.approx(in_best_units, rel=1e-9) or limit == pytest.approx(as_is, rel=1e-9)


def test_forward_and_reverse_agree_where_the_guard_fires():
    matrix = torch.stack([defective(4), torch.eye(4, dtype=torch.float64), random_matrix(4, torch.float64, 21)])
    direction, limit = random_matrix(4, torch.float64, 22, 3), 2.0
    leaf = matrix.clone().requires_grad_()
    _, tangents = jvp(lambda A: eig(A, limit)[:3], (matrix,), (direction,))
    for i, (output, tangent) in enumerate(zip(eig(leaf, limit)[:3], tangents, strict=True)):
        weight = torch.randn(output.shape, dtype=output.dtype, generator=torch.Generator().manual_seed(i))
        (slope,) = torch.autograd.grad((output * weight).sum().real, leaf, retain_graph=True)
        expected = (tangent * weight).sum().real
        assert float((slope * direction).sum()) == pytest.approx(float(expected), rel=1e-10, abs=1e-10)


# ---- what is no number, and what is no matrix ----------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e305])
def test_a_matrix_without_spectrum_spoils_nothing_but_its_own_place(bad, dtype):
    matrix = random_matrix(3, dtype, 23, 3)
    alone = matrix[[0, 2]].clone().requires_grad_()
    matrix[1, 0, 2] = bad
    matrix.requires_grad_()
    system, pair = eig(matrix), eig(alone)
    for part, good in zip(system, pair, strict=True):
        assert torch.equal(part[[0, 2]], good)
    assert all(part[1].real.isnan().all() for part in system[:3])
    assert system.guarded[1] == eigvals(matrix)[1][1] == 0
    loss, expected = (s.eigenvalues.abs().sum() + s.eigenvectors.abs().pow(3).sum() for s in (system, pair))
    (slope,) = torch.autograd.grad(loss, matrix)
    (good_slope,) = torch.autograd.grad(expected, alone)
    torch.testing.assert_close(slope[[0, 2]], good_slope)
    assert (slope[1] == 0.0).all()
    for tangent in jvp(outputs, (matrix.detach(),), (torch.full_like(matrix, 1.0),))[1]:
        assert (tangent[1] == 0.0).all()
        assert torch.isfinite(tangent.abs()).all()


@pytest.mark.parametrize(
    ("matrix", "limit", "message"),
    [
        (torch.zeros(3), 1e8, r"square matrices .* got shape \(3,\)"),
        (torch.zeros(2, 3), 1e8, r"got shape \(2, 3\)"),
        (torch.zeros(4, 0, 0), 1e8, r"got shape \(4, 0, 0\)"),
        (torch.zeros(2, 2, dtype=torch.int64), 1e8, "got torch.int64"),
        (torch.zeros(2, 2), 0.5, "max_condition=0.5"),
        (torch.zeros(2, 2), float("nan"), "max_condition=nan"),
        (torch.zeros(2, 2), float("inf"), "max_condition=inf"),
    ],
)
def test_what_is_no_matrix_or_no_limit_is_refused(matrix, limit, message):
    for function in (eig, eigvals):
        with pytest.raises(ValueError, match=message):
            function(matrix, limit)
