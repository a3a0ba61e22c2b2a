"""What the user's own terms may ask for, and the terms of peers that ship with the package."""

import numpy as np
import pytest
import torch

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.setup import build
from eigenode_cli.model import flat_parameters
from eigenode_cli.terms.arguments import arguments_of
from eigenode_cli.terms.peers import EDGE, derivative_matching, jacobian_norm, smoothed
from eigenode_cli.terms.user import TermFailed, load_user_terms, user_term
from tests.conftest import make_case
from tests.measured import series
from tests.terms import own

FACTORS = (1.0, -25.0, -0.05)
"""dx/dt = (a v, b s + c v): the oscillator of the paper."""


class Oscillator(torch.nn.Module):
    """The oscillator's true field."""

    structure = "second_order"
    has_symbolic_jacobian = False

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        s, v = x[..., 0], x[..., 1]
        return torch.stack([FACTORS[0] * v, FACTORS[1] * s + FACTORS[2] * v], dim=-1)


def seen(noise: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Times and positions of the paper's oscillator."""
    data = make_case("oscillator").problem().data
    shown = data.seen + noise * np.random.default_rng(0).standard_normal(data.values.shape)
    return torch.from_numpy(data.times), torch.from_numpy(shown)


def test_arguments_are_asked_for_by_name() -> None:
    def mine(field, trajectory, weight=2.0, *rest, **options):
        return weight * trajectory

    assert arguments_of(mine) == ("field", "trajectory")
    term = user_term(mine)
    assert term.needs_solve
    known = dict.fromkeys(("spectra", "times", "data", "field"))
    assert float(term(trajectory=torch.tensor(3.0), **known)) == 6.0
    assert not user_term(derivative_matching).needs_solve


def test_what_there_is_not_is_named() -> None:
    with pytest.raises(ValueError, match="unknown argument 'trajectroy', did you mean trajectory"):
        arguments_of(lambda trajectroy: trajectroy)

    def positional(trajectory, /):
        return trajectory

    with pytest.raises(ValueError, match="argument 'trajectory' can't be given by name"):
        arguments_of(positional)


def test_terms_come_in_the_order_of_their_names() -> None:
    """Which is that of the recorded columns, whatever order they were typed in."""
    peers = "eigenode_cli.terms.peers"
    paths = {"match": f"{peers}:derivative_matching", "jac": f"{peers}:jacobian_norm"}
    terms = load_user_terms(paths, ("jac", "match"), print)
    assert list(terms) == ["jac", "match"]


def test_unobserved_states_are_not_seen() -> None:
    states = np.arange(6.0).reshape(3, 2)
    mask = np.array([[True, False], [True, False], [False, False]])
    shown = series(np.arange(3.0), states, mask).seen
    np.testing.assert_array_equal(shown, [[0.0, 1.0], [2.0, np.nan], [np.nan, np.nan]])


def test_the_true_field_matches_the_derivatives_of_the_data() -> None:
    times, shown = seen()
    assert float(derivative_matching(times, shown, Oscillator())) < 1e-6  # type: ignore[arg-type]
    times, shown = seen(noise=0.05)
    assert float(derivative_matching(times, shown, Oscillator())) < 0.05  # type: ignore[arg-type]


def test_matching_needs_every_state_or_its_position() -> None:
    field = Oscillator()
    field.structure = "full"
    with pytest.raises(ValueError, match="nothing shows state 1"):
        derivative_matching(*seen(), field)  # type: ignore[arg-type]
    times, shown = seen()
    with pytest.raises(ValueError, match="10 data times of state 0 are too few"):
        derivative_matching(times[: 4 + 2 * EDGE], shown[: 4 + 2 * EDGE], Oscillator())  # type: ignore[arg-type]


def test_smoothing_keeps_a_signal_and_takes_noise_away() -> None:
    times = np.sort(np.random.default_rng(1).uniform(0.0, 10.0, size=201))
    signal = np.cos(3.0 * times)
    np.testing.assert_allclose(smoothed(times, signal), signal, atol=2e-3)
    noise = 0.1 * np.random.default_rng(2).standard_normal(times.size)
    assert np.std(smoothed(times, signal + noise) - signal) < 0.5 * np.std(noise)


def test_jacobian_norm_of_a_linear_field() -> None:
    trajectory = torch.zeros((5, 2), dtype=torch.float64)
    expected = sum(factor**2 for factor in FACTORS)
    assert float(jacobian_norm(trajectory, Oscillator())) == pytest.approx(expected, rel=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_term_that_does_not_depend_on_anything_has_no_gradient(engine: str) -> None:
    config = typed(compose([f"engine={engine}", "+terms.late=tests.terms.test_user:late", "grads=sol+late"]))
    setup = build(config, print)
    found = setup.engine.loss_jacobian(flat_parameters(setup.field))
    assert found.values[1] == pytest.approx(setup.problem.data.times.mean())
    np.testing.assert_array_equal(found.gradients[1], 0.0)
    assert found.gradients[0].any()


def late(times: torch.Tensor) -> torch.Tensor:
    return times.mean()


def configured(engine: str, name: str, grads: str) -> TrainConfig:
    words = ["system=sparse_oscillator", f"engine={engine}", f"+terms.own=tests.terms.own:{name}", f"grads={grads}"]
    return typed(compose(words))


@pytest.mark.parametrize("engine", ["compiled", "torch"])
@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("broken", "terms.own=tests.terms.own:broken: KeyError: 'no such\\nthing'"),
        (
            "not_differentiable",
            "terms.own=tests.terms.own:not_differentiable: no gradient, RuntimeError: one of the",
        ),
    ],
)
def test_a_term_that_fails_is_named(engine: str, name: str, answer: str) -> None:
    setup = build(configured(engine, name, "sol+own"), print)
    with pytest.raises(TermFailed) as raised:
        setup.engine.loss_jacobian(flat_parameters(setup.field))
    assert str(raised.value).startswith(answer)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_what_is_no_value_is_named_where_it_shows_later(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    config = configured(engine, "calm", "sol+own")
    monkeypatch.setattr(own, "calm", own.vector)
    setup = build(config, print)
    with pytest.raises(TermFailed, match=r"^terms.own=tests.terms.own:calm: returns a tensor of shape \(14,\); it"):
        setup.engine.loss_jacobian(flat_parameters(setup.field))


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_failing_term_that_is_only_recorded_has_no_value(engine: str) -> None:
    said: list[str] = []
    setup = build(configured(engine, "broken", "sol"), said.append)
    theta, times = flat_parameters(setup.field), np.array([0.0, 1.0])
    setup.engine.evaluate(theta, times)  # it may have to compile, and say so
    said[:] = [line for line in said if not line.startswith("compiling")]
    values = [setup.engine.evaluate(theta, times).values for _ in range(2)]
    assert np.isnan([row[-1] for row in values]).all()
    assert np.isfinite(values[0][0])
    assert [line.split(" (")[0] for line in said] == ["terms.own=tests.terms.own:broken: KeyError: 'no such\\nthing'"]


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_term_that_is_only_recorded_needs_no_derivative(engine: str) -> None:
    said: list[str] = []
    setup = build(configured(engine, "not_differentiable", "sol"), said.append)
    assert np.isfinite(setup.engine.evaluate(flat_parameters(setup.field), np.array([0.0, 1.0])).values[-1])
    assert [line for line in said if not line.startswith("compiling")] == []
