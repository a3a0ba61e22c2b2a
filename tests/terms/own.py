"""Terms of a user's own, right and wrong ones."""

import numpy as np
import torch
from torch import Tensor


def calm(trajectory: Tensor) -> Tensor:
    return (trajectory[:, 1] ** 2).mean()


def vector(trajectory: Tensor) -> Tensor:
    return trajectory[:, 1] ** 2


def number(trajectory: Tensor) -> float:
    return float(trajectory.detach().sum())


def array(times: Tensor) -> np.ndarray:
    return times.numpy()


def nothing(times: Tensor) -> None:
    del times


def whole(times: Tensor) -> Tensor:
    return (times > 0.0).sum()


def complex_value(spectra: Tensor) -> Tensor:
    return spectra.mean()


def broken(trajectory: Tensor) -> Tensor:
    del trajectory
    raise KeyError("no such\nthing")


def not_differentiable(trajectory: Tensor) -> Tensor:
    squares = trajectory**2
    roots = squares.exp()
    value = roots.sum()
    with torch.no_grad():
        roots += 1.0
    return value + roots.log().sum()
