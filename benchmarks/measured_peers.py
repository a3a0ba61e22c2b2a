"""Peers on the measured records, each with the same data and the same part held out: test errors, medians over seeds.

python benchmarks/measured_peers.py --data DIR --seeds 5 --output benchmarks/measured_peers.json

DIR has a folder for each record that does not ship (docs/measured.md names their sources); without it the shipped ones
are taken alone. Needs the extra `peers` (pysindy). Each row is written when it is there, so that a script that is cut
off leaves those that it has.
"""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import argparse
import json
import shlex
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pysindy
from omegaconf import OmegaConf
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.config.prediction import holdout_of
from eigenode_cli.config.setup import build
from eigenode_cli.console import number, show_table
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct
from eigenode_cli.engines.base import unheard
from eigenode_cli.engines.holdout import Holdout

EXPERIMENTS = Path(__file__).parents[1] / "experiments" / "measured"
FOLDERS = {
    "shaker": None,
    "driven_simulated": None,
    "lynx_hare": None,
    "sl_oscillator": "sl_oscillator",
    "sl_pendulum": "sl_pendulum",
    "sl_two_masses": "sl_two_masses",
    "sl_double_pendulum": "sl_double_pendulum",
    "wheel_radial": "bicycle_wheel_gyro",
    "wheel_axial": "bicycle_wheel_gyro",
    "driven_pendulum": "driven_pendulum",
}
"""Folder of each record in DIR; None of one that ships."""
THRESHOLDS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Of SINDy's sparse regression, in internal units; the one that simulates the training part best is taken."""
DEGREE, FAR, MOST = 3, 30.0, 50_000
"""Degree of its library; a simulation ends where a state exceeds FAR internal units, or after MOST evaluations."""
PLAIN = ("optimizer=adam", "grads=sol", "network.linear=none", "network.output_gain=1", "stages=[{}]")
PLAIN += ("trainer.steps=5000", "trainer.record_every=500")


class Stopped(Exception):
    """A simulation that leaves, or takes too long."""


def record_words(name: str, folder: Path | None) -> list[str]:
    """Return the settings of a record without those of its optimizer, as overrides."""
    found = OmegaConf.load(EXPERIMENTS / f"{name}.yaml")
    words = ["system=table", "protocol=robust"]
    for group in ("system", "network", "target"):
        for key, value in (OmegaConf.to_container(found.get(group, OmegaConf.create({}))) or {}).items():
            words.append(f"{group}.{key}={_typed(value)}")
    return words if folder is None else [*words, f"system.folder={folder}"]


def _typed(value: Any) -> str:
    return f"[{','.join(map(_typed, value))}]" if isinstance(value, list) else "null" if value is None else str(value)


def sindy_error(run: en.RecordedRun) -> float:
    """Return the test error of SINDy, infinite where its simulation does not reach all that was held out."""
    setup = build(run.config, unheard)
    holdout, structure = holdout_of(setup), run.config.network.structure
    if holdout is None:
        raise TypeError("simulated data")
    every = setup.dataset.series
    estimates = [reconstruct(series, structure) for series in every]
    best = (np.inf, np.inf)
    for threshold in THRESHOLDS:
        model = fitted(every, estimates, threshold)
        if model is not None:
            best = min(best, judged(model, holdout, estimates))
    return float(best[1])


def fitted(every: Sequence[Series], estimates: Sequence[Estimate], threshold: float) -> Any:
    """Return the sparse model of the reconstructed rates, None where the regression fails."""
    parts = []
    for series, estimate in zip(every, estimates, strict=True):
        known = np.isfinite(estimate.states).all(axis=1) & np.isfinite(estimate.rates).all(axis=1)
        parts.append((estimate.states[known], estimate.rates[known], series.times[known], series.driven[known]))
    states, rates, times, inputs = (list(part) for part in zip(*parts, strict=True))
    library = pysindy.PolynomialLibrary(degree=DEGREE)
    model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-6), feature_library=library)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            model.fit(states, t=times, x_dot=rates, u=inputs if inputs[0].shape[1] else None)
        except (ValueError, np.linalg.LinAlgError):
            return None
    return model


def judged(model: Any, holdout: Holdout, estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Return the error over what was trained and the test error, of a simulation from the first state."""
    shown, trained = [], []
    for number_, part in enumerate(holdout.parts):
        series, n = part.series, part.series.states
        estimate = estimates[min(number_, len(estimates) - 1)]
        start = series.initial_state if part.trained == 0 else estimate.states[0]
        states = simulated(model, series, np.nan_to_num(start))
        shown.append(states + estimate.offsets[:n])
        seen = slice(0, part.trained)
        wrong = (shown[-1][seen] - series.seen[seen])[series.mask[seen]]
        trained.append(wrong)
    inside = np.concatenate(trained)
    error = float(np.sqrt(np.mean(inside**2))) if inside.size and np.isfinite(inside).all() else np.inf
    return error, holdout.error_of(shown)


def simulated(model: Any, series: Series, start: Floats) -> Floats:
    """Return the states `(N, n)`, NaN where the simulation does not arrive."""
    count = 0
    inputs = series.driven

    def rate(t: float, x: Floats) -> Floats:
        nonlocal count
        count += 1
        if count > MOST or np.abs(x).max() > FAR:
            raise Stopped
        u = None
        if inputs.shape[1]:
            u = np.array([[np.interp(t, series.times, column) for column in inputs.T]])
        return np.asarray(model.predict(x[None], u=u))[0]

    found = np.full((series.times.size, start.size), np.nan)
    found[0], x = start, start
    try:
        for i in range(1, series.times.size):
            span = (series.times[i - 1], series.times[i])
            x = solve_ivp(rate, span, x, rtol=1e-6, atol=1e-8).y[:, -1]
            found[i] = x
    except (Stopped, ValueError):
        pass
    return found


def errors_of(words: Sequence[str], seeds: int, folder: Path) -> tuple[list[float], en.RecordedRun]:
    """Return the test errors over the seeds, infinite of a run that did not finish, and the first run."""
    errors, first = [], None
    for seed in range(seeds):
        run = en.train(*words, "trainer.figures=false", f"seed={seed}", folder=folder / str(seed))
        first = first or run
        value = run.record["final"].get("test_error") if run.status == "finished" else None
        errors.append(float("inf") if value is None or not np.isfinite(value) else float(value))
    if first is None:
        raise ValueError("no seed")
    return errors, first


def rows_of(data: Path | None, seeds: int) -> Iterator[dict[str, Any]]:
    """Yield the errors of one record after another."""
    for name, own in FOLDERS.items():
        folder = None if own is None else (data or Path()) / own
        if own is not None and data is None:
            continue
        place = [] if folder is None else [f"system.folder={folder}"]
        with tempfile.TemporaryDirectory() as made:
            ours, run = errors_of([f"measured={name}", *place], seeds, Path(made) / "eigenode")
            plain, _ = errors_of([*record_words(name, folder), *PLAIN], seeds, Path(made) / "plain")
            sindy = sindy_error(run)
        yield {
            "record": name,
            **run.record["baselines"],
            "sindy": sindy,
            "plain_node": {"median": float(np.median(plain)), "failed": int(np.isinf(plain).sum()), "all": plain},
            "eigenode": {"median": float(np.median(ours)), "failed": int(np.isinf(ours).sum()), "all": ours},
        }


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    rows = []
    for row in rows_of(None if args.data is None else args.data.resolve(), args.seeds):
        rows.append(row)
        print(row["record"], row["linear"], row["sindy"], row["plain_node"]["median"], row["eigenode"]["median"])
        command = shlex.join(["python", "benchmarks/measured_peers.py", "--data", "DIR", "--seeds", str(args.seeds)])
        content = {"command": command, "pysindy": version("pysindy"), "python": sys.version.split()[0], "rows": rows}
        args.output.write_text(json.dumps(content, indent=2) + "\n")
    header = ("record", "repetition", "linear", "SINDy", "plain NODE", "eigenode")
    table = [
        [
            row["record"],
            *(number(row[name]) for name in ("repetition", "linear", "sindy")),
            *(number(row[name]["median"]) for name in ("plain_node", "eigenode")),
        ]
        for row in rows
    ]
    show_table(header, table, f"test errors, medians of {args.seeds} seeds", right=header[1:])


if __name__ == "__main__":
    main()
