"""The typed schema of every setting. No defaults stand here: they are in `configs/`, where people look for them.

Each choice of a group has a class of its own with exactly the options that it reads, so that an option which the
chosen method would ignore is an unknown key. Importing this module costs nothing: no torch, no Numba.
"""
# ruff: noqa: RUF009  # option() is dataclasses.field() with a constraint

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from omegaconf import MISSING

from eigenode_cli.config import names
from eigenode_cli.config.optimizer_schema import (
    AdamBfgsConfig,
    CosineConfig,
    ExponentialConfig,
    FirstOrderAdamConfig,
    LeastSquaresConfig,
    OptimizerConfig,
    PlateauConfig,
    ScheduleConfig,
    SgdConfig,
)
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.config.validators import option


@dataclass
class SystemConfig:
    """Ground truth and how it is observed; each system adds its own parameters, with units, in a subclass."""

    name: str = MISSING
    """The choice that `system=` made: what folders, files and figures show."""
    target: str = MISSING
    """The class, `module:Class`; its constructor takes the options that are not here."""
    initial_state: list[float] = MISSING
    """State at time 0, one value a state."""
    horizon: float = option(above=0)
    """Time of the last data point in s."""
    points: int = option(at_least=2)
    """Number of equidistant data times, both ends included."""
    observed: list[str] = MISSING
    """Names of the states that the data shows and SOL compares."""
    noise: float = option(at_least=0)
    """Standard deviation of Gaussian noise on what the data shows, as a share of each state's largest modulus. What is
    known of the initial state has none, and targets are those of the truth."""
    initial_known: list[str] | None = MISSING
    """Names of the states whose value at time 0 is known; null for all. The others start from a trained value."""


@dataclass
class OscillatorConfig(SystemConfig):
    """Translational spring-damper oscillator (Equ. 16)."""

    c: float = MISSING
    """Spring constant in N/m."""
    d: float = MISSING
    """Damping constant in N s/m."""
    m: float = option(above=0)
    """Mass in kg."""


@dataclass
class VanDerPolConfig(SystemConfig):
    """Van der Pol oscillator (Equ. 18)."""

    mu: float = MISSING
    """Strength of the nonlinear damping, without unit."""


@dataclass
class NetworkConfig:
    """The learned part of the vector field."""

    name: str = MISSING
    target: str = MISSING
    """The class, `module:Class`; its constructor takes the options that are not here."""
    structure: str = option(choices=names.STRUCTURES)
    """How the network's output becomes dx/dt: second_order | full."""
    linear: str = option(choices=names.LINEARS)
    """A learned linear part beside the network, and its initial value: none (there is none) | zero | fitted (to the
    measurements, by linear least squares) | modes (a system with the pairs of the target)."""
    output_gain: float = option(at_least=0)
    """Factor of the initial output of the network: small, and the field starts as its linear part."""


@dataclass
class MlpConfig(NetworkConfig):
    """Multilayer perceptron."""

    hidden: list[int] = option(at_least=1)
    """Width of each hidden layer."""
    activation: str = option(choices=names.ACTIVATIONS)
    """Activation of the hidden layers; the output layer is linear."""
    init: str = option(choices=names.INITS)
    """Initial weights: glorot | uniform01 | kaiming."""
    input_scaling: str = option(choices=names.SCALINGS)
    """none | max_abs: divide each state by its largest modulus in the data."""
    output_scaling: str = option(choices=names.SCALINGS)
    """none | max_abs: multiply each output by the largest modulus of that derivative in the data."""
    scaling_from: str = option(choices=names.SCALING_SOURCES)
    """What those largest values are taken from: data (measured states, the others reconstructed) | truth (the reference
    solution, as in the authors' code)."""


@dataclass
class PolynomialConfig(NetworkConfig):
    """All monomials of the states up to a degree, with learned coefficients."""

    degree: int = option(at_least=0)
    spread: float = option(at_least=0)
    """Initial coefficients are uniform in [-spread, spread]."""


@dataclass
class SolverConfig:
    """Integrator of the vector field."""

    name: str = MISSING


@dataclass
class OwnSolverConfig(SolverConfig):
    """A method of the user's own."""

    target: str = MISSING
    """The class, `module:Class`; its constructor takes the options that are not here."""


@dataclass
class AdaptiveSolverConfig(SolverConfig):
    """Embedded Runge-Kutta method with step-size control."""

    rtol: float = option(above=0)
    atol: float = option(above=0)
    max_steps: int = option(at_least=1)
    """Attempted steps after which a solve ends with the status max_steps."""


@dataclass
class FixedSolverConfig(SolverConfig):
    """Method with a fixed step."""

    step: float = option(above=0)
    """Step size in s."""


@dataclass
class CombineConfig:
    """How several gradients become optimizer steps."""

    name: str = MISSING


@dataclass
class SequentialConfig(CombineConfig):
    """One optimizer step for each gradient."""

    repeat_last_update: bool = MISSING
    """Make the last step, the change of the weights by the last gradient that acts, once more without another update of
    the optimizer's memory (a quirk of the authors' first code)."""


@dataclass
class EngineConfig:
    """What computes the loss Jacobian."""

    name: str = MISSING


@dataclass
class CompiledEngineConfig(EngineConfig):
    """Machine code from Numba."""

    sensitivity: str = option(choices=names.SENSITIVITIES)
    """How the solver's sensitivities are computed: auto | forward | adjoint."""


@dataclass
class TargetConfig:
    """What the spectral terms compare the spectrum with."""

    name: str = MISSING
    at: str = option(choices=names.TARGETS_AT)
    """Where the target holds, and the spectrum is compared with it: trajectory | equilibrium."""
    stiffness: list[float] | None = option(at_least=1)
    """Corridor [low, high] of the stiffness ratio instead of the target's own, or null; [1, 1] for fast simulation."""


@dataclass
class TruthTargetConfig(TargetConfig):
    """Targets from the truth along its own trajectory."""

    frequency_factor: float = option(above=0)
    """Factor on the truth's frequencies: anything but 1 trains on a wrong target, to see what that costs."""


@dataclass
class StatedTargetConfig(TargetConfig):
    """Targets stated by the user, the same at all times."""

    frequency: list[Any] = option(above=0)
    """Frequency |Im|/2 pi of each pair in Hz (the damped one): a value, or a range [low, high]."""
    damping: list[Any] = option(above=-1, below=1)
    """Damping ratio of each pair, in the same order: a value, or a range [low, high]."""
    undamped: bool = MISSING
    """Whether the frequencies are undamped ones, |lambda|/2 pi, as a modal test may state them."""


@dataclass
class StageConfig:
    """One part of a training; a stage in a list leaves out what is as usual, so that these settings have defaults."""

    steps: int | None = option(at_least=1, default=None)
    """Training steps; null for an equal share of those that no other stage takes."""
    terms: str | None = option(default=None)
    """Terms, joined by +, whose gradients train; null for those of `grads`."""
    horizons: list[float] = option(above=0, at_most=1, default=(1.0,))
    """Growing horizon: leading fractions of it, each trained for an equal share of the stage's steps."""
    spectra: str = option(choices=names.SPECTRA_AT, default="trajectory")
    """Where the spectral terms that train are taken: trajectory (the model's own, up to the growing horizon) | data
    (all data states). The recorded ones are those along the trajectory."""
    solve: bool = option(default=True)
    """Whether anything is solved; false trains the spectral terms alone, at the data states."""
    trained: list[str] | None = option(choices=names.BLOCKS, default=None)
    """Blocks of parameters that train, some of network, linear, initial_state; null for all. The others are held."""


@dataclass
class StopConfig:
    """Rules, asked at every record, that end a training before its last step; null where one does not apply."""

    patience: int | None = option(at_least=1)
    """Records without a new lowest sum of the scaled terms."""
    sol: float | None = option(at_least=0)
    """SOL that is low enough."""
    seconds: float | None = option(above=0)
    """Training time in s."""


@dataclass
class TrainerConfig:
    """Length of the training and what is written."""

    steps: int = option(at_least=1)
    record_every: int = option(at_least=1)
    """Steps between rows of metrics.csv."""
    checkpoint_every: int = option(at_least=1)
    """Steps between checkpoints."""
    figures: bool = MISSING
    """Whether figures and the report are made at the end; `eigenode plot` and `report` make them later."""
    on_unsolvable: str = option(choices=names.ON_UNSOLVABLE)
    """What to do when a solve fails: stabilise (without SOL, by the spectral terms) | retry (half of the step, from the
    last weights that could be solved; stabilise before there are any) | skip | stop."""
    keep: str = option(choices=names.KEPT)
    """Which weights are the result: last (those of the last step) | best (those of the record with the lowest sum of
    the scaled terms)."""
    start: str | None = MISSING
    """Warm start: the folder of a run, or one of its checkpoints, whose weights this one starts from; null for none."""
    stop: StopConfig = MISSING


@dataclass
class EigenConfig:
    """Spectra along the trajectory."""

    every: int = option(at_least=1)
    """A spectrum at every k-th data time."""
    jacobian: str = option(choices=names.JACOBIANS)
    """How A = df/dx is computed: autodiff | finite_difference | symbolic."""
    max_condition: float = option(at_least=1)
    """Guard: largest eigenvalue condition number that a sensitivity may show."""
    margin: float = MISSING
    """Stability margin of STB in 1/s."""
    eigenvalue_count: str = option(choices=names.EIGENVALUE_COUNTS)
    """What the gradients of FRQ, DMP, STB and OSC are divided by: spectrum (the number of eigenvalues) | times (half
    the number of data times, a quirk of the authors' code for the journal). The recorded losses do not depend on it."""


@dataclass
class StepConfig:
    """The fixed-step solver that the learned field is to run on, which STP keeps to."""

    method: str = option(choices=names.STEPPERS)
    step: float | None = option(above=0)
    """Step size in s; null for none."""


@dataclass
class ErrorConfig:
    """Error function of each term: mae | mse | huber."""

    sol: str = option(choices=names.ERRORS)
    frq: str = option(choices=names.ERRORS)
    dmp: str = option(choices=names.ERRORS)
    stb: str = option(choices=names.ERRORS)
    osc: str = option(choices=names.ERRORS)
    stf: str = option(choices=names.ERRORS)
    stp: str = option(choices=names.ERRORS)
    huber_delta: float = option(above=0)
    """Difference at which huber turns from a square to a line."""


if TYPE_CHECKING:
    Source = SystemConfig | TableConfig
else:  # OmegaConf knows no unions of classes
    Source = Any


@dataclass
class TrainConfig:
    """Everything that one run depends on."""

    system: Source = MISSING
    network: NetworkConfig = MISSING
    solver: SolverConfig = MISSING
    optimizer: OptimizerConfig = MISSING
    schedule: ScheduleConfig = MISSING
    combine: CombineConfig = MISSING
    engine: EngineConfig = MISSING
    target: TargetConfig = MISSING
    trainer: TrainerConfig = MISSING
    stages: list[StageConfig] = MISSING
    """The training as a list of stages, one after another."""
    eigen: EigenConfig = MISSING
    stp: StepConfig = MISSING
    error: ErrorConfig = MISSING
    protocol: str = MISSING
    """Name of the full set of training choices."""
    grads: str = MISSING
    """Terms whose gradients train, joined by +."""
    scale: dict[str, float] = option(at_least=0)
    """Factor of each term's gradient."""
    terms: dict[str, str] = MISSING
    """The user's own terms: name to `module:function`."""
    seed: int = option(at_least=0, below=2**63)
    """Of the initial weights and of every other draw."""
    repetitions: int = option(at_least=1)
    """Runs side by side that differ in the seed alone: `seed` and those that follow it."""


ADAPTIVE: tuple[str, ...] = (
    "tsit5",
    "dopri5",
    "dopri8",
    "bosh3",
    "adaptive_heun",
    "fehlberg2",
    "rodas5p",
    "rosenbrock23",
    "auto",
)
FIXED: tuple[str, ...] = ("rk4", "euler", "midpoint", "heun3")

SCHEMAS: Mapping[str, Mapping[str, type]] = {
    "system": {"oscillator": OscillatorConfig, "vdp": VanDerPolConfig, "table": TableConfig},
    "network": {"mlp": MlpConfig, "polynomial": PolynomialConfig},
    "solver": {**dict.fromkeys(ADAPTIVE, AdaptiveSolverConfig), **dict.fromkeys(FIXED, FixedSolverConfig)},
    "optimizer": {
        "adam": FirstOrderAdamConfig,
        "adam_bfgs": AdamBfgsConfig,
        "lm": LeastSquaresConfig,
        "sgd": SgdConfig,
    },
    "schedule": {
        "constant": ScheduleConfig,
        "exponential": ExponentialConfig,
        "cosine": CosineConfig,
        "plateau": PlateauConfig,
    },
    "combine": {"sequential": SequentialConfig, **dict.fromkeys(("sum", "mean", "switch", "mix"), CombineConfig)},
    "engine": {"auto": EngineConfig, "torch": EngineConfig, "compiled": CompiledEngineConfig},
    "target": {"truth": TruthTargetConfig, "stated": StatedTargetConfig},
}
"""Schema of each shipped choice, registered with Hydra as `schema/<group>/<choice>`."""
