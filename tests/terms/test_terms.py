"""The term kernels against a plain transcription of the paper's equations under autograd; their exact properties."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from eigenode_cli.data.targets import StatedTarget, Targets, targets_of_spectra
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.model import flat_parameters
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver
from eigenode_cli.solve.stability import METHODS, region_of, stability_polynomial
from eigenode_cli.solve.torchdiffeq_solvers import FIXED
from eigenode_cli.solve.trajectory import solve
from eigenode_cli.terms import NAMES, PAPER_TERMS
from eigenode_cli.terms.errors import ERRORS
from eigenode_cli.terms.torch_terms import solution_term, spectral_values
from tests.conftest import make_case
from tests.measured import series

DELTA, STEP = 0.3, 0.4
ERROR_FUNCTIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "mae": torch.abs,
    "mse": lambda r: r**2,
    "huber": lambda r: torch.where(r.abs() <= DELTA, 0.5 * r**2, DELTA * (r.abs() - 0.5 * DELTA)),
}


def errors(kind: str) -> np.ndarray:
    return np.full(len(NAMES), ERRORS[kind], dtype=np.int64)


def with_step(targets: Targets) -> Targets:
    return replace(targets, region=region_of("rk4", STEP))


def value_of(term: str, spectra: Tensor, targets: Targets, kind: str = "mae", margin: float = 0.0) -> Tensor:
    return spectral_values(spectra, [term], targets, margin, errors(kind), DELTA)[0]


def spectrum(*values: complex) -> Tensor:
    return torch.tensor([values], dtype=torch.complex128)


# Model and target spectra with distinct everything: pairs and real ones, stable and unstable, 2 and 4 eigenvalues.
PAIR = spectrum(-0.2 + 3.0j, -0.2 - 3.0j)
UNSTABLE_PAIR = spectrum(0.4 + 2.0j, 0.4 - 2.0j)
REAL = spectrum(1.5, -0.5)
TWO_PAIRS = spectrum(-0.1 + 9.0j, 0.3 + 4.0j, 0.3 - 4.0j, -0.1 - 9.0j)
PAIR_AND_REAL = spectrum(2.0, -0.3 + 5.0j, -0.3 - 5.0j, -1.0)
FOUR_REAL = spectrum(0.5, -3.0, 1.25, -1.0)
TARGETS = {
    2: [spectrum(-0.5 + 2.0j, -0.5 - 2.0j), spectrum(-1.0, -4.0)],
    4: [spectrum(-1 + 3j, -1 - 3j, -2 + 8j, -2 - 8j)],
}
MODELS = [PAIR, UNSTABLE_PAIR, REAL, TWO_PAIRS, PAIR_AND_REAL, FOUR_REAL]


def transcription(term: str, lam: Tensor, goal: Tensor, kind: str) -> Tensor:
    """The paper's equations for one spectrum, normalised as published, by plain torch operations."""
    eps = ERROR_FUNCTIONS[kind]
    model_pairs = sorted((z for z in lam if z.imag > 0), key=lambda z: z.imag.item())
    goal_pairs = sorted((z for z in goal if z.imag > 0), key=lambda z: z.imag.item())
    size = lam.numel()
    zero = torch.zeros((), dtype=torch.float64)
    if term == "stb":
        return sum((eps(torch.clamp(z.real, min=0.0)) for z in lam), zero) / size
    if term == "stp":
        z = STEP * lam
        growth = 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0
        return sum((eps(torch.clamp(size_of - 1.0, min=0.0)) for size_of in growth.abs()), zero) / size
    if term == "stf":
        real, wanted = lam.real.abs(), goal.real.abs()
        return eps(real.max() / real.min() - wanted.max() / wanted.min())
    if term == "osc":
        alone = [z.real for z in lam if z.imag == 0]
        reals = torch.sort(torch.stack(alone)).values if alone else zero[None]
        gaps = [eps(reals[i] - reals[i + 1]) for i in range(reals.numel() - 1)]
        missing = len(goal_pairs) - len(model_pairs)
        if missing <= 0:
            return zero
        return (gaps[0] + gaps[2] if missing == 2 else min(gaps, key=lambda gap: gap.item())) / size
    if term == "frq":
        pairs = [2.0 * eps((a.imag.abs() - b.imag) / (2 * math.pi)) for a, b in matched(model_pairs, goal_pairs)]
    else:
        pairs = [2.0 * eps(-a.real / a.abs() + b.real / b.abs()) for a, b in matched(model_pairs, goal_pairs)]
    return sum(pairs, zero) / size


def matched(model: list[Tensor], goal: list[Tensor]) -> list[tuple[Tensor, Tensor]]:
    if len(model) == len(goal):
        return list(zip(model, goal, strict=True))
    if len(model) == 1:
        return [(model[0], min(goal, key=lambda g: abs(g.item() - model[0].item())))]
    assert not model
    return []


@pytest.mark.parametrize("kind", ERRORS)
@pytest.mark.parametrize("term", NAMES[1:])
@pytest.mark.parametrize("model", MODELS, ids=lambda m: " ".join(f"{z:.1f}" for z in m[0].tolist()))
def test_value_and_slope_are_those_of_the_equation(term: str, model: Tensor, kind: str) -> None:
    for goal in TARGETS[model.shape[1]]:
        targets = with_step(targets_of_spectra(goal.numpy()))
        if term in ("frq", "dmp") and targets.pairs[0] == 0 and bool((model.imag != 0).any()):
            assert float(value_of(term, model, targets, kind)) == 0.0  # acts only where both sides have a pair
            continue
        kernel_input = model.clone().requires_grad_()
        plain_input = model.clone().requires_grad_()
        ours = value_of(term, kernel_input, targets, kind)
        # members of a pair enter the transcription once, the kernel's sum over both members weighs them equally
        theirs = transcription(term, plain_input[0], goal[0], kind)
        torch.testing.assert_close(ours, theirs, rtol=1e-14, atol=1e-15)
        (our_slope,) = torch.autograd.grad(ours, kernel_input)
        their_slope = (
            torch.autograd.grad(theirs, plain_input)[0] if theirs.requires_grad else torch.zeros_like(plain_input)
        )
        # along directions that keep the spectrum that of a real matrix, the only ones that exist
        for direction in conjugate_directions(model[0]):
            ours_along = float((our_slope.conj() * direction).real.sum())
            theirs_along = float((their_slope.conj() * direction).real.sum())
            assert ours_along == pytest.approx(theirs_along, rel=1e-12, abs=1e-14)


def conjugate_directions(lam: Tensor) -> list[Tensor]:
    directions = []
    for i, z in enumerate(lam):
        if z.imag < 0:
            continue
        for unit in (1.0, 1.0j):
            if z.imag == 0 and unit == 1.0j:
                continue
            d = torch.zeros(1, lam.numel(), dtype=torch.complex128)
            d[0, i] = unit
            if z.imag > 0:
                partner = int((lam - z.conj()).abs().argmin())
                d[0, partner] = np.conj(unit)
            directions.append(d)
    return directions


@pytest.mark.parametrize("term", NAMES[1:])
def test_forward_and_reverse_mode_agree(term: str) -> None:
    goal = torch.cat([TARGETS[2][0], TARGETS[2][0], TARGETS[2][0]])
    model = torch.cat([PAIR, UNSTABLE_PAIR, REAL])
    targets = with_step(targets_of_spectra(goal.numpy()))
    direction = torch.randn(3, 2, dtype=torch.complex128, generator=torch.Generator().manual_seed(3))
    value = lambda lam: value_of(term, lam, targets)  # noqa: E731
    with torch.autograd.forward_ad.dual_level():
        dual = torch.autograd.forward_ad.make_dual(model, direction)
        forward = torch.autograd.forward_ad.unpack_dual(value(dual)).tangent
    lam = model.clone().requires_grad_()
    (slope,) = torch.autograd.grad(value(lam), lam)
    assert float((slope.conj() * direction).real.sum()) == pytest.approx(float(forward), rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("term", NAMES[1:])
@pytest.mark.parametrize("model", [TWO_PAIRS, PAIR_AND_REAL, FOUR_REAL])
def test_permutation_of_the_spectrum_changes_nothing(term: str, model: Tensor) -> None:
    targets = with_step(targets_of_spectra(TARGETS[4][0].numpy()))
    value = float(value_of(term, model, targets))
    for shift in range(1, 4):
        assert float(value_of(term, model.roll(shift, dims=1), targets)) == pytest.approx(value, rel=1e-15)


def test_exact_values() -> None:
    targets = targets_of_spectra(spectrum(-1.0 + 2.0j, -1.0 - 2.0j).numpy())
    assert float(value_of("frq", PAIR, targets)) == pytest.approx(1.0 / (2.0 * math.pi))
    assert float(value_of("stb", UNSTABLE_PAIR, targets)) == pytest.approx(0.4)
    assert float(value_of("stb", REAL, targets)) == pytest.approx(0.75)
    assert float(value_of("osc", REAL, targets)) == pytest.approx(1.0)
    assert float(value_of("osc", PAIR, targets)) == 0.0
    assert float(value_of("stf", REAL, targets)) == pytest.approx(2.0)  # 3 against 1 of a single pair
    assert float(value_of("dmp", spectrum(-1.0 + 2.0j, -1.0 - 2.0j), targets)) == 0.0


def test_margin_asks_for_more_than_the_border() -> None:
    targets = targets_of_spectra(PAIR.numpy())
    assert float(value_of("stb", PAIR, targets, margin=0.1)) == 0.0
    assert float(value_of("stb", PAIR, targets, margin=0.5)) == pytest.approx(0.3)


def test_stiffness_corridor() -> None:
    targets = targets_of_spectra(PAIR.numpy())
    for corridor, value in (([1.0, 5.0], 0.0), ([1.0, 2.0], 1.0), ([4.0, 5.0], 1.0), ([1.0, 1.0], 2.0)):
        targets.stiffness[:] = corridor
        assert float(value_of("stf", REAL, targets)) == pytest.approx(value)


def recorded(term: str, model: Tensor, targets: Targets) -> float:
    return float(spectral_values(model, [term], targets, 0.0, errors("mae"), DELTA, recorded=True)[0])


@pytest.mark.parametrize(
    ("term", "model", "goal"),
    [
        ("frq", REAL, PAIR),
        ("dmp", REAL, PAIR),
        ("frq", PAIR, REAL),
        ("dmp", PAIR, REAL),
        ("osc", REAL, REAL),
        ("osc", PAIR, REAL),
        ("stf", spectrum(0.0, -1.0), PAIR),
        ("stf", PAIR, spectrum(0.0, -1.0)),
    ],
)
def test_where_nothing_can_be_compared_nothing_is_recorded_and_zero_trains(
    term: str, model: Tensor, goal: Tensor
) -> None:
    targets = targets_of_spectra(goal.numpy())
    lam = model.clone().requires_grad_()
    value = value_of(term, lam, targets)
    assert value.item() == 0.0
    assert not torch.autograd.grad(value, lam)[0].any()
    assert math.isnan(recorded(term, model, targets))
    # one spectrum with something to compare is enough
    both = targets_of_spectra(torch.cat([goal, PAIR]).numpy())
    assert recorded(term, torch.cat([model, PAIR]), both) == 0.0


def test_what_was_compared_and_fits_is_recorded_as_zero() -> None:
    targets = targets_of_spectra(PAIR.numpy())
    assert [recorded(term, PAIR, targets) for term in PAPER_TERMS[1:]] == [0.0] * 5
    assert math.isnan(recorded("stp", PAIR, targets))
    assert recorded("stp", PAIR, with_step(targets)) == 0.0


def test_infinite_stiffness_contributes_nothing() -> None:
    infinite = targets_of_spectra(spectrum(0.0, -1.0).numpy())
    assert np.isinf(infinite.stiffness).all()
    assert float(value_of("stf", REAL, infinite)) == 0.0
    finite = targets_of_spectra(REAL.numpy())
    lam = spectrum(0.0, -1.0).requires_grad_()
    value = value_of("stf", lam, finite)
    assert value.item() == 0.0
    assert bool((torch.autograd.grad(value, lam)[0] == 0).all())


def test_spectra_that_are_not_finite_do_not_count() -> None:
    targets = targets_of_spectra(torch.cat([PAIR, PAIR]).numpy())
    broken = torch.cat([spectrum(complex(math.nan, 0.0), 1.0), UNSTABLE_PAIR])
    assert float(value_of("stb", broken, targets)) == pytest.approx(0.4)
    assert math.isnan(float(value_of("stb", broken[:1], targets)))


def test_solution_term_is_the_mean_over_what_is_observed() -> None:
    states = torch.tensor([[1.0, 9.0], [2.0, 9.0], [4.0, 9.0]], dtype=torch.float64, requires_grad=True)
    mask = np.array([[True, False], [False, False], [True, False]])
    data = series(np.arange(3.0), np.array([[0.0, 0.0], [0.0, 0.0], [7.0, 0.0]]), mask)
    value = solution_term(states, data, ERRORS["mae"], DELTA)
    assert float(value.detach()) == pytest.approx(2.0)
    (slope,) = torch.autograd.grad(value, states)
    assert slope.tolist() == [[0.5, 0.0], [0.0, 0.0], [-0.5, 0.0]]


@given(
    st.lists(st.floats(0.1, 9.0), min_size=1, max_size=5, unique=True),
    st.lists(st.floats(0.1, 9.0), min_size=1, max_size=5, unique=True),
)
def test_matching_is_the_optimal_assignment(model: list[float], goal: list[float]) -> None:
    """All modes have one real part, so that distances are differences of frequency."""
    n = 2 * len(model)
    lam = np.array([[sign * 2j * math.pi * f - 0.1 for f in model for sign in (1, -1)]])
    targets = targets_of_spectra(np.array([[sign * 2j * math.pi * f - 0.1 for f in goal for sign in (1, -1)]]))
    cost = np.abs(np.subtract.outer(model, goal))
    optimum = 2.0 * cost[linear_sum_assignment(cost)].sum() / n
    assert float(value_of("frq", torch.from_numpy(lam), targets)) == pytest.approx(optimum, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_inside_a_range_nothing_is_wrong(engine: str) -> None:
    """Half a range wider than the distance the term is zero, narrower it is the rest of the distance."""
    case = make_case("oscillator")
    problem, field = case.problem(terms=("sol", "frq", "dmp")), case.field(linear="zero", output_gain=0.01)
    theta = flat_parameters(field)
    theta[-2:] = -30.0, -0.3  # 0.872 Hz with damping ratio 0.027, beside 0.796 Hz and 0.005
    plain = build_engine(field, problem, engine=engine).loss_jacobian(theta)
    for part, row in (("frequency", 1), ("damping", 2)):
        middle = getattr(problem.targets, part)
        for share, left in ((2.0, 0.0), (0.25, 0.75)):
            targets = replace(problem.targets, **{f"{part}_tolerance": np.full_like(middle, share * plain.values[row])})
            found = build_engine(field, replace(problem, targets=targets), engine=engine).loss_jacobian(theta)
            assert found.values[row] == pytest.approx(left * plain.values[row], rel=0.02, abs=1e-12)
            np.testing.assert_allclose(found.gradients[row], (left > 0.0) * plain.gradients[row], rtol=1e-9, atol=1e-12)


def test_a_stated_range_is_its_middle_and_half_its_width() -> None:
    target = StatedTarget([(1.9, 2.1), 0.5], [0.02, (0.0, 0.1)])
    rows = target.rows(np.zeros(2))
    np.testing.assert_allclose(rows.frequency[0], [0.5, 2.0])
    np.testing.assert_allclose(rows.frequency_tolerance[1], [0.0, 0.1])
    np.testing.assert_allclose(rows.damping[0], [0.05, 0.02])
    np.testing.assert_allclose(rows.damping_tolerance[0], [0.05, 0.0])


@pytest.mark.parametrize("name", METHODS)
def test_a_stability_function_is_what_a_step_does(name: str) -> None:
    """One step of the method on `x' = lambda x` multiplies by R; it is the exponential to the method's order."""
    coefficients = stability_polynomial(name)
    order = {"euler": 1, "midpoint": 2, "adaptive_heun": 2, "heun3": 3, "bosh3": 3, "rk4": 4}.get(name, 5)
    expected = [1.0 / math.factorial(k) for k in range(order + 1)]
    np.testing.assert_allclose(coefficients[: order + 1], expected, rtol=1e-12)
    rate, step = -1.7, 0.9
    config = FixedStepSolver(name, step) if name in FIXED else AdaptiveSolver(name, rtol=1.0, atol=1.0)
    times, start = torch.tensor([0.0, step], dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    found = solve(lambda x: rate * x, start, times, config, [step]).states[-1, 0]
    assert float(found) == pytest.approx(np.polynomial.Polynomial(coefficients)(rate * step), rel=1e-12)


def test_known_bounds_of_stability() -> None:
    """The real and imaginary axes that explicit Euler and RK4 allow."""
    for name, last in (("euler", -2.0), ("rk4", -2.785293563405282)):
        for share, zero in ((0.999, True), (1.001, False)):
            targets = replace(targets_of_spectra(PAIR.numpy()), region=region_of(name, 1.0))
            assert (float(value_of("stp", spectrum(share * last, -0.5), targets)) == 0.0) is zero
    targets = replace(targets_of_spectra(PAIR.numpy()), region=region_of("rk4", 1.0))
    limit = 2.0 * math.sqrt(2.0)
    assert float(value_of("stp", spectrum(0.999j * limit, -0.999j * limit), targets)) == 0.0
    assert float(value_of("stp", spectrum(1.001j * limit, -1.001j * limit), targets)) > 0.0
    assert float(value_of("stp", spectrum(-2.5, 0.1), replace(targets, region=region_of("euler", 1.0)))) == (
        pytest.approx(0.5 * (0.5 + 0.1))
    )
