"""What the record of a run says of measured data: files, trajectories, internal units."""

from typing import Any

from eigenode_cli.config.setup import Setup
from eigenode_cli.data.source import Source
from eigenode_cli.terms import TERMS


def measured_description(source: Source) -> dict[str, Any]:
    """Return the part of run.json about measured data."""
    measured, scaling = source.measured, source.scaling
    if measured is None:
        return {}
    return {
        "inputs": [vars(one) for one in source.inputs],
        "time_unit": measured.unit,
        "notes": list(measured.notes),
        "trajectories": [
            {
                "label": one.label,
                "rows": int(one.series.times.size),
                "trained": one.trained,
                "start": float(one.series.times[0]),
                "end": float(one.series.times[-1]),
            }
            for one in measured.trajectories
        ],
        "scaling": {
            "time": scaling.time,
            "states": scaling.states.tolist(),
            "inputs": scaling.inputs.tolist(),
        },
    }


def recorded_units(setup: Setup) -> dict[str, float]:
    """Return the factors that bring recorded terms and `max_real` from the internal unit of time to s, by name."""
    time, error = setup.source.scaling.time, setup.config.error
    if setup.source.truth is not None:
        return {}
    inverse = [name for name, term in TERMS.items() if term.unit in ("frequency", "angular")]
    factors = {name: time ** (-2 if getattr(error, name) == "mse" else -1) for name in inverse}
    return factors | {"max_real": 1.0 / time}
