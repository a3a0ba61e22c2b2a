"""Build the objects that a configuration describes."""

from dataclasses import fields
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.config.names import damped_frequencies, stated_ranges
from eigenode_cli.config.optimizer_schema import AdamConfig, OwnOptimizerConfig
from eigenode_cli.config.outline import outline_of
from eigenode_cli.config.plugins import load_class, own_options
from eigenode_cli.config.schema import (
    AdamBfgsConfig,
    AdaptiveSolverConfig,
    CombineConfig,
    CosineConfig,
    ExponentialConfig,
    FixedSolverConfig,
    LeastSquaresConfig,
    NetworkConfig,
    OwnSolverConfig,
    PlateauConfig,
    SequentialConfig,
    SgdConfig,
    SolverConfig,
    StatedTargetConfig,
    SystemConfig,
    TargetConfig,
    TrainConfig,
    TruthTargetConfig,
)
from eigenode_cli.config.table import measured_of
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.systems import System
from eigenode_cli.terms import TERMS

if TYPE_CHECKING:
    from eigenode_cli.data.dataset import Dataset
    from eigenode_cli.data.simulate import Truth
    from eigenode_cli.data.source import Source
    from eigenode_cli.data.targets import Target
    from eigenode_cli.model import VectorField
    from eigenode_cli.training.methods import Method, OwnMethod
    from eigenode_cli.training.options import TrainerOptions
    from eigenode_cli.training.schedules import Schedule
    from eigenode_cli.training.stages import Stage


def build_system(config: Any) -> System:
    """Build the system of a `SystemConfig`.

    Raises:
        ValueError: what its constructor raises for parameters that do not fit together.
    """
    return load_class(config.target)(**own_options(config, SystemConfig))


def build_truth(config: SystemConfig) -> "Truth":
    """Build the truth that a system's data are sampled from."""
    from eigenode_cli.data.simulate import Truth  # noqa: PLC0415  # SciPy, and a command line is checked without it

    return Truth(build_system(config), tuple(float(value) for value in config.initial_state))


def build_source(config: TrainConfig) -> "Source":
    """Build where the data come from: simulated, or read.

    Raises:
        UserError: a table cannot be read.
        ValueError: the system cannot be solved.
    """
    from eigenode_cli.data.source import measured_source, simulated_source  # noqa: PLC0415  # SciPy, as below

    system = config.system
    if isinstance(system, TableConfig):
        ranges = damped_frequencies(config.target) if isinstance(config.target, StatedTargetConfig) else []
        stated = [0.5 * (low + high) for low, high in ranges]
        return measured_source(measured_of(system), config.network.structure, stated)
    truth = build_truth(system)
    return simulated_source(truth, build_dataset(system, truth, config.seed))


def build_dataset(config: SystemConfig, truth: "Truth", seed: int) -> "Dataset":
    """Build what is measured of the truth; `seed` is that of the noise.

    Raises:
        ValueError: the system cannot be solved.
    """
    from eigenode_cli.data.simulate import simulate  # noqa: PLC0415

    times = np.linspace(0.0, config.horizon, config.points)
    return simulate(truth, times, config.observed, config.noise, seed, config.initial_known)


def build_target(config: TargetConfig, source: "Source") -> "Target":
    """Build what the spectral terms compare with, in the internal unit of time."""
    from eigenode_cli.data.targets import StatedTarget, TruthTarget  # noqa: PLC0415

    corridor = None if config.stiffness is None else (config.stiffness[0], config.stiffness[1])
    if isinstance(config, StatedTargetConfig):
        internal = source.scaling.frequency
        frequencies = [(internal(low), internal(high)) for low, high in damped_frequencies(config)]
        return StatedTarget(frequencies, stated_ranges(config.damping), corridor)
    if isinstance(config, TruthTargetConfig) and source.truth is not None:
        return TruthTarget(source.truth, config.frequency_factor, corridor)
    raise TypeError(f"no targets come from a {type(config).__name__}")


def build_solver(config: SolverConfig, unit: float = 1.0) -> Solver:
    """Build the solver settings; a fixed step is divided by the unit of time, in s."""
    if isinstance(config, OwnSolverConfig):
        return load_class(config.target)(name=config.name, **own_options(config, OwnSolverConfig))
    if isinstance(config, AdaptiveSolverConfig):
        return AdaptiveSolver(config.name, config.rtol, config.atol, config.max_steps)
    return FixedStepSolver(config.name, cast(FixedSolverConfig, config).step / unit)


def build_own_method(config: OwnOptimizerConfig) -> "OwnMethod":
    """Build an optimizer's method of the user's own."""
    return load_class(config.target)(lr=config.lr, **own_options(config, OwnOptimizerConfig))


def build_method(config: TrainConfig) -> "Method | OwnMethod":
    """Build the optimizer's method."""
    from eigenode_cli.training.methods import Adam, AdamBfgs, LevenbergMarquardt, Sgd  # noqa: PLC0415  # Numba

    optimizer = config.optimizer
    if isinstance(optimizer, OwnOptimizerConfig):
        return build_own_method(optimizer)
    kinds = (
        (AdamBfgsConfig, AdamBfgs),
        (LeastSquaresConfig, LevenbergMarquardt),
        (AdamConfig, Adam),
        (SgdConfig, Sgd),
    )
    method = next(method for schema, method in kinds if isinstance(optimizer, schema))
    options = {entry.name: getattr(optimizer, entry.name) for entry in fields(method) if hasattr(optimizer, entry.name)}
    if method is LevenbergMarquardt and config.error.sol == "huber":
        options["huber"] = config.error.huber_delta
    return method(**options)


def build_schedule(config: TrainConfig) -> "Schedule":
    """Build the schedule of the learning rate."""
    from eigenode_cli.training.schedules import Cosine, Exponential, Plateau, Schedule  # noqa: PLC0415

    schedule = config.schedule
    if isinstance(schedule, ExponentialConfig):
        return Exponential(schedule.extra, schedule.rate, schedule.every)
    if isinstance(schedule, CosineConfig):
        return Cosine(config.trainer.steps, schedule.final)
    if isinstance(schedule, PlateauConfig):
        return Plateau(schedule.factor, schedule.patience, schedule.smallest)
    return Schedule()


def build_stages(config: TrainConfig) -> tuple["Stage", ...]:
    """Build the list of stages."""
    from eigenode_cli.terms import canonical, split_grads  # noqa: PLC0415
    from eigenode_cli.training.stages import Stage  # noqa: PLC0415  # Numba

    return tuple(
        Stage(
            steps=stage.steps,
            terms=None if stage.terms is None else canonical(split_grads(stage.terms)),
            horizons=tuple(stage.horizons),
            spectra=stage.spectra,
            solve=stage.solve,
            trained=None if stage.trained is None else tuple(stage.trained),
        )
        for stage in config.stages
    )


def build_options(config: TrainConfig) -> "TrainerOptions":
    """Build the trainer's options."""
    from eigenode_cli.training.options import Stopping, TrainerOptions  # noqa: PLC0415  # torch

    trainer, stop = config.trainer, config.trainer.stop
    return TrainerOptions(
        steps=trainer.steps,
        record_every=trainer.record_every,
        checkpoint_every=trainer.checkpoint_every,
        on_unsolvable=trainer.on_unsolvable,
        keep=trainer.keep,
        stopping=Stopping(stop.patience, stop.sol, stop.seconds),
    )


def combination(config: CombineConfig) -> int:
    """Return the code of the combination."""
    from eigenode_cli.engines.combine import COMBINATIONS, SEQUENTIAL_REPEATING_LAST  # noqa: PLC0415  # Numba

    if isinstance(config, SequentialConfig) and config.repeat_last_update:
        return SEQUENTIAL_REPEATING_LAST
    return COMBINATIONS[config.name]


def gradient_scales(config: TrainConfig) -> dict[str, float]:
    """Return the factor of each term's gradient, by name.

    Under `eigen.eigenvalue_count=times` the terms that average over eigenvalues count N/2 of them (N data times)
    instead of n. That is a constant factor, so it is applied here and the recorded losses stay what they are.
    """
    scales = {name: float(scale) for name, scale in config.scale.items()} | {
        name: float(config.scale.get(name, 1.0)) for name in config.terms
    }
    if config.eigen.eigenvalue_count == "times":
        for name in (name for name, term in TERMS.items() if term.per_eigenvalue):
            shape = outline_of(config.system)
            scales[name] *= len(shape.states) / (shape.points / 2.0)
    return scales


def build_field(
    config: NetworkConfig,
    states: Floats,
    rates: Floats,
    seed: int,
    linear: Floats | None = None,
    inputs: Floats | None = None,
) -> "VectorField":
    """Build the vector field, its network's initial weights drawn from `seed`.

    Args:
        config: of the network.
        states: states `(N, n)` that the scale of the inputs is taken from.
        rates: their derivatives `(N, n)`, for the scale of the outputs.
        seed: of the initial weights; nothing else enters the draw, so that runs of one seed are paired.
        linear: initial value of the linear part `(m, n + k)`, zero where None.
        inputs: of the system `(N, k)`, None where there are none.
    """
    import torch  # noqa: PLC0415  # seconds, and a command line is checked without it

    from eigenode_cli.model import VectorField, scale_output  # noqa: PLC0415

    n, k = states.shape[1], 0 if inputs is None else inputs.shape[1]
    outputs = n // 2 if config.structure == "second_order" else n
    options = own_options(config, NetworkConfig)
    options.pop("scaling_from", None)
    for scaling, scale, samples in (
        ("input_scaling", "input_scale", states if inputs is None else np.hstack([states, inputs])),
        ("output_scaling", "output_scale", rates[:, n - outputs :]),
    ):
        if scaling in options:
            if options.pop(scaling) == "max_abs":
                largest = torch.from_numpy(_largest(samples))
                options[scale] = 1.0 / largest if scale == "input_scale" else largest
            else:
                options[scale] = None
    generator = torch.Generator().manual_seed(seed)
    network = load_class(config.target)(inputs=n + k, outputs=outputs, generator=generator, **options)
    if config.output_gain != 1.0:
        scale_output(network, config.output_gain)
    matrix = torch.zeros((outputs, n + k), dtype=torch.float64) if linear is None else torch.from_numpy(linear)
    return VectorField(network, config.structure, None if config.linear == "none" else matrix, inputs=k)


def _largest(samples: Floats) -> Floats:
    """Return the largest modulus of each column of `samples (N, k)`; 1 for a column of zeros."""
    size = np.abs(samples).max(axis=0)
    return np.where(size > 0.0, size, 1.0)
