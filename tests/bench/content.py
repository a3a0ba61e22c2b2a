"""A bench.json made by hand, of the shape that `run_bench` gives."""

from typing import Any


def ratio(median: float) -> dict[str, Any]:
    return {
        "median": median,
        "low": 0.9 * median,
        "high": 1.1 * median,
        "least": 0.8 * median,
        "pairs": 5,
        "numerator_seconds": 1e-3 * median,
        "denominator_seconds": 1e-3,
        "numerator_cores": 1.0,
        "denominator_cores": 1.0,
    }


def part(holds: bool) -> dict[str, Any]:
    row = {"values": [0.0], "gradients": [0.0], "steps": 10}
    return {"holds": holds, "tight": row, "timed": row}


def made(diffrax: float = 8.0, agrees: bool = True) -> dict[str, Any]:
    case = {
        "terms": ["sol"],
        "parameters": 129,
        "steps": 10,
        "values": [0.5],
        "agreement": {"torchdiffeq": part(True), "diffrax": part(agrees)},
        "timed_differs_because": "",
        "ratios": {"torchdiffeq": ratio(900.0), "diffrax": ratio(diffrax)},
        "details": {"compiled": "Tsit5", "torchdiffeq": "dopri5", "diffrax": "Tsit5"},
        "train_seconds": 1.0,
        "step_over_floor": ratio(2.0),
        "two_threads": ratio(1.9),
        "six_over_one": {"adjoint": {"sol": ratio(1.5), "frq": ratio(1.05)}},
        "gradient_over_step": ratio(1200.0),
    }
    curve = {
        "quantity": "states",
        "values": [2, 10, 100],
        "exponents": {"compiled": 1.0, "diffrax": 1.5},
        "ratios": {"diffrax": [ratio(3.0), ratio(2.0), ratio(0.5)]},
        "seconds": {"compiled": [1e-4, 5e-4, 5e-3], "diffrax": [3e-4, 1e-3, 2.5e-3]},
        "disagree": {},
        "slower_than": {"diffrax": [100]},
    }
    return {
        "machine": {"cores": 2},
        "tolerances": {"rtol": 1e-3},
        "missing": {"torchode": ["torchode"]},
        "cases": {"oscillator-sol": case, "oscillator-all": case, "vdp": case},
        "growth": {"states, sol, 21 spectra": curve},
        "goals": [],
    }
