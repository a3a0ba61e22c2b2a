"""Folders of runs that never were: deterministic numbers in the shape of real ones, for figures and the report."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

TERMS = ("sol", "frq", "dmp", "stb", "osc", "stf")
METRICS = ("step", "train_seconds", "lr", *TERMS, "max_real", "n_accepted", "n_rejected", "status", "dense_error")


def cell(value: Any) -> str:
    """As it stands in a CSV file: all digits, empty where there is no number."""
    if isinstance(value, float | np.floating):
        return repr(float(value)) if np.isfinite(value) else ""
    return str(value)


def write_csv(path: Path, header: Sequence[str], rows: Any) -> None:
    """One CSV file."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([[cell(value) for value in row] for row in rows])


def change_json(folder: Path, **changes: Any) -> None:
    """Replace top-level keys of run.json."""
    path = folder / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def write_run_json(folder: Path, system: dict[str, Any], grads: str, horizon: float, observed: Sequence[str]) -> None:
    """run.json of a finished run."""
    config = {
        "system": {"name": system["name"], "horizon": horizon, "points": 101, "observed": list(observed)},
        "network": {"name": "mlp", "structure": "second_order", "hidden": [32], "activation": "tanh", "init": "glorot"},
        "solver": {"name": "tsit5", "rtol": 1e-3, "atol": 1e-6, "max_steps": 10000},
        "optimizer": {"name": "adam", "lr": 1e-3, "beta1": 0.9, "beta2": 0.999, "eps": 1e-8},
        "combine": {"name": "sequential"},
        "trainer": {"steps": 5000, "record_every": 25, "on_unsolvable": "stabilise"},
        "error": {**dict.fromkeys(TERMS, "mae"), "huber_delta": 1.0},
        "protocol": "paper",
        "grads": grads,
        "scale": {"sol": 1.0, "frq": 10.0, "dmp": 1.0, "stb": 1000.0, "osc": 10.0, "stf": 0.1},
        "terms": {},
        "stp": {"method": "rk4", "step": 0.05},
        "seed": 0,
    }
    record = {
        "status": "finished",
        "error": None,
        "config": config,
        "seed": 0,
        "system": system,
        "engine": "torch",
        "parameters": 129,
        "command": f"eigenode train system={system['name']} grads={grads}",
        "versions": {"eigenode": "0.1.0", "python": "3.11.7", "torch": "2.13.0", "numpy": "2.4.6"},
        "git_commit": "0123456789abcdef0123456789abcdef01234567",
        "steps": 5000,
        "train_seconds": 1234.5,
        "final": {},
    }
    (folder / "run.json").write_text(json.dumps(record))


def write_metrics(folder: Path, minimum: float, final: float, seed: int, real: tuple[float, float]) -> None:
    """201 records: a wild start with three failed solves, a local minimum from step 500 to 1800, and the way out."""
    rng = np.random.default_rng(seed)
    step = np.arange(0, 5001, 25)
    leave = 1.0 / (1.0 + np.exp((step - 2150.0) / 90.0))
    settle = final * (1.0 + 1.5 * np.exp(-(step - 2000.0).clip(0.0) / 900.0))
    noise = np.exp(rng.normal(0.0, 0.004 + 0.12 * (step > 2200), step.size))
    sol = (minimum * leave + settle * (1.0 - leave) + 2.0 * np.exp(-step / 70.0)) * noise
    frq = (0.8 * leave + 0.004 + 0.5 * np.exp(-step / 200.0)) * np.exp(rng.normal(0.0, 0.15, step.size))
    dmp = (0.05 * leave + 0.002) * np.exp(rng.normal(0.0, 0.2, step.size)) + 0.8 * np.exp(-step / 150.0)
    stb = np.where(step < 700, 2.0 * np.exp(-step / 90.0), 0.0)
    osc = np.where(step < 400, 5.0 * np.exp(-step / 60.0), 0.0)
    max_real = real[0] * np.exp(-step / 80.0) + real[1] * (1.0 + rng.normal(0.0, 0.15, step.size))
    failed = np.isin(step, [25, 50, 100])
    status = np.where(failed, "underflow", "ok")
    rows = [
        (
            int(step[i]),
            round(0.24 * float(step[i]), 6),
            1e-3,
            *(np.nan if failed[i] else sol[i], frq[i], dmp[i], stb[i], osc[i], 1.0),
            max_real[i],
            37 + i % 7,
            2,
            str(status[i]),
            np.nan if failed[i] else 1.1 * sol[i],
        )
        for i in range(step.size)
    ]
    write_csv(folder / "metrics.csv", METRICS, rows)


def write_solution(folder: Path, times: np.ndarray, truth: np.ndarray, model: np.ndarray, names: Sequence[str]) -> None:
    """solution.csv of truth and model `(D, n)` on a grid whose first half is the training horizon."""
    header = ["t", *(f"truth_{name}" for name in names), *(f"model_{name}" for name in names), "horizon"]
    inside = times <= 0.5 * times[-1] + 1e-9
    rows = [(times[i], *truth[i], *model[i], "train" if inside[i] else "beyond") for i in range(times.size)]
    write_csv(folder / "solution.csv", header, rows)


def write_eigenvalues(folder: Path, times: np.ndarray, values: np.ndarray, targets: np.ndarray) -> None:
    """eigenvalues.csv of spectra `(T, n)` and their targets."""
    rows = [
        (times[t], mode, values[t, mode].real, values[t, mode].imag, targets[t, mode].real, targets[t, mode].imag)
        for t in range(times.size)
        for mode in range(values.shape[1])
    ]
    write_csv(folder / "eigenvalues.csv", ("t", "mode", "re", "im", "target_re", "target_im"), rows)


def spiral(times: np.ndarray, eigenvalue: complex, amplitude: float = 1.0) -> np.ndarray:
    """Position and velocity `(D, 2)` of `Re(a exp(lambda t))`."""
    z = amplitude * np.exp(eigenvalue * times)
    return np.column_stack([z.real, (eigenvalue * z).real])


def write_oscillator(folder: Path) -> Path:
    """A fit of the paper's oscillator that passes a local minimum."""
    folder.mkdir(parents=True)
    states = [{"name": "s", "unit": "m", "symbol": "s"}, {"name": "v", "unit": "m/s", "symbol": "v"}]
    write_run_json(
        folder, {"name": "oscillator", "title": "Oscillator", "states": states}, "sol+frq+dmp+osc", 10.0, ["s"]
    )
    write_metrics(folder, minimum=0.578, final=0.013, seed=1, real=(60.0, -0.02))
    times = np.linspace(0.0, 20.0, 2001)
    truth, model = spiral(times, -0.025 + 5.0j), spiral(times, -0.023 + 4.996j)
    write_solution(folder, times, truth, model, ["s", "v"])
    data_times = np.linspace(0.0, 10.0, 101)
    position = spiral(data_times, -0.025 + 5.0j)[:, 0]
    write_csv(folder / "data.csv", ("t", "s", "v"), [(t, s, np.nan) for t, s in zip(data_times, position, strict=True)])
    upper = -0.025 + 0.012 * np.cos(5.0 * data_times) + 1j * (5.0 + 0.05 * np.sin(0.6 * data_times))
    target = np.full(101, -0.025 + 5.0j)
    write_eigenvalues(
        folder, data_times, np.column_stack([upper, upper.conj()]), np.column_stack([target, target.conj()])
    )
    return folder


def write_van_der_pol(folder: Path) -> Path:
    """A fit of the Van der Pol oscillator, mu = 2, whose eigenvalues move and split along the trajectory."""
    folder.mkdir(parents=True)
    states = [
        {"name": "nu", "unit": "", "symbol": r"\nu"},
        {"name": "nu_dot", "unit": "1/s", "symbol": r"\dot{\nu}"},
    ]
    system = {"name": "vdp", "title": "Van der Pol oscillator", "states": states}
    write_run_json(folder, system, "sol+frq+dmp+osc", 30.0, ["nu"])
    write_metrics(folder, minimum=1.1, final=0.08, seed=2, real=(8.0, 1.9))
    times = np.linspace(0.0, 60.0, 3001)
    truth, model = _limit_cycle(times, 2.0), _limit_cycle(times, 1.93)
    write_solution(folder, times, truth, model, ["nu", "nu_dot"])
    every = np.arange(0, 1501, 16)
    data_times = times[every]
    rows = [(t, nu, np.nan) for t, nu in zip(data_times, truth[every, 0], strict=True)]
    write_csv(folder / "data.csv", ("t", "nu", "nu_dot"), rows)
    write_eigenvalues(folder, data_times, _spectra(model[every], 1.93), _spectra(truth[every], 2.0))
    return folder


def write_two_mass(folder: Path) -> Path:
    """Four states, two of them observed, three modes: one pair and two real ones; a diverging model."""
    folder.mkdir(parents=True)
    names = ["s1", "v1", "s2", "v2"]
    symbols = ["s_1", "v_1", "s_2", "v_2"]
    states = [
        {"name": name, "unit": "m" if name[0] == "s" else "m/s", "symbol": symbol}
        for name, symbol in zip(names, symbols, strict=True)
    ]
    system = {"name": "two_mass", "title": "Two masses", "states": states}
    write_run_json(folder, system, "sol+stb", 10.0, ["s1", "s2"])
    write_metrics(folder, minimum=0.3, final=0.2, seed=3, real=(3.0, 0.02))
    times = np.linspace(0.0, 20.0, 1001)
    truth = np.hstack([spiral(times, -0.1 + 3.0j), spiral(times, -0.3 + 7.0j, 0.01)])
    model = np.hstack([spiral(times, 0.35 + 3.1j, 0.5), spiral(times, -0.2 + 6.5j, 0.012)])
    model[700:] = np.nan
    write_solution(folder, times, truth, model, names)
    every = np.arange(0, 501, 10)
    rows = [(times[i], truth[i, 0], np.nan, truth[i, 2] if i % 20 else np.nan, np.nan) for i in every]
    write_csv(folder / "data.csv", ("t", *names), rows)
    ones = np.ones(every.size)
    values = np.column_stack([(-0.1 + 3.0j) * ones, (-0.1 - 3.0j) * ones, -0.4 * ones, (-200.0 + times[every]) * ones])
    targets = np.full(values.shape, complex(np.nan, np.nan))
    targets[:, 0], targets[:, 1] = -0.1 + 3.0j, -0.1 - 3.0j
    write_eigenvalues(folder, times[every], values, targets)
    return folder


def write_unsolvable(folder: Path) -> Path:
    """An oscillator run whose every solve failed: nothing but the initial state and empty cells."""
    write_oscillator(folder)
    rows = [(25 * i, 0.1 * i, 1e-3, *[np.nan] * 7, 3, 4, "underflow", np.nan) for i in range(21)]
    write_csv(folder / "metrics.csv", METRICS, rows)
    times = np.linspace(0.0, 20.0, 401)
    model = np.full((401, 2), np.nan)
    write_solution(folder, times, spiral(times, -0.025 + 5.0j), model, ["s", "v"])
    nothing = np.full((11, 2), complex(np.nan, np.nan))
    write_eigenvalues(folder, np.linspace(0.0, 10.0, 11), nothing, nothing)
    change_json(folder, status="failed", error="the field could not be solved at any step")
    return folder


def write_single_record(folder: Path) -> Path:
    """An oscillator run of no training step: one record, at step 0."""
    write_oscillator(folder)
    row = (0, 0.0, 1e-3, 1.37, 0.8, 1.0, 0.4, 2.0, 3.0, 7.1, 38, 2, "ok", 1.4)
    write_csv(folder / "metrics.csv", METRICS, [row])
    return folder


def _limit_cycle(times: np.ndarray, mu: float) -> np.ndarray:
    """Van der Pol oscillator `(D, 2)` from (2, 0) by Runge-Kutta's method at a fixed step."""

    def slope(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0]])

    states = np.empty((times.size, 2))
    states[0] = 2.0, 0.0
    h = times[1] - times[0]
    for i in range(times.size - 1):
        x = states[i]
        k1 = slope(x)
        k2 = slope(x + 0.5 * h * k1)
        k3 = slope(x + 0.5 * h * k2)
        k4 = slope(x + h * k3)
        states[i + 1] = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return states


def _spectra(states: np.ndarray, mu: float) -> np.ndarray:
    """Eigenvalues `(T, 2)` of the Van der Pol oscillator at its states."""
    nu, rate = states.T
    half = 0.5 * mu * (1.0 - nu**2)
    root = np.sqrt(half**2 - 2.0 * mu * nu * rate - 1.0 + 0j)
    return np.column_stack([half + root, half - root])
