"""The user's own terms evaluated once before a run: on the truth's trajectory and spectra, with the initial network."""

from collections.abc import Iterator

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.build import build_field, build_system
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data.simulate import sample, truth_spectra, with_noise
from eigenode_cli.terms.user import load_user_terms, value_fault


def rehearse(config: DictConfig) -> Iterator[str]:
    """A fault for each own term of a configuration, valid otherwise, whose value is none.

    A term that raises is left to the run, which keeps its traceback: it may need what only a training gives it.
    """
    settings = TrainConfig(**vars(OmegaConf.to_object(config)))
    system = build_system(settings.system)
    start = np.array(settings.system.initial_state, dtype=np.float64)
    try:
        truth = sample(system, start, settings.system.horizon, settings.system.points, settings.system.observed)
    except ValueError:  # the run says so
        return
    known = {
        "trajectory": torch.from_numpy(truth.states).requires_grad_(),
        "spectra": torch.from_numpy(truth_spectra(system, truth.states[:: settings.eigen.every], 1.0)).requires_grad_(),
        "times": torch.from_numpy(truth.times),
        "data": torch.from_numpy(with_noise(truth, settings.system.noise, settings.seed).seen),
        "field": build_field(settings.network, truth.states, system.dynamics(truth.states), settings.seed),
    }
    for term in load_user_terms(settings.terms, tuple(settings.terms), print).values():
        try:
            value = term.function(**{name: known[name] for name in term.takes})
        except Exception:  # the user's code may raise anything
            continue
        fault = value_fault(value)
        if fault is not None:
            yield f"{term.label}: {fault}"
