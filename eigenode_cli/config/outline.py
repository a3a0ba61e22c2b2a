"""What the checks and the shapes of a run need to know of its system, whether it is a truth or a table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.schema import SystemConfig
from eigenode_cli.config.table_schema import TableConfig


@dataclass(frozen=True)
class Outline:
    """Shapes of a system.

    Attributes:
        states: names of the states `(n,)`; inputs: number of inputs k.
        observed: names of the states that were measured, or follow from what was.
        points: data times of the longest trajectory.
        unknown: trained entries of all initial states; offsets: trained offsets of all trajectories.
    """

    states: tuple[str, ...]
    inputs: int
    observed: tuple[str, ...]
    points: int
    unknown: int
    offsets: int

    @property
    def blocks(self) -> Mapping[str, int]:
        """Sizes of the blocks of parameters that belong to trajectories."""
        return {"initial_state": self.unknown, "offset": self.offsets}


def is_table(system: Any) -> bool:
    """Whether a node or an object of the group `system` names tables."""
    return (OmegaConf.get_type(system) if isinstance(system, DictConfig) else type(system)) is TableConfig


def shape_of(system: SystemConfig | TableConfig) -> tuple[int, int]:
    """Return the numbers of states n and of inputs k; no file is read."""
    if isinstance(system, TableConfig):
        from eigenode_cli.config.table import roles_of  # noqa: PLC0415  # SciPy

        return len(roles_of(system).state_names), len(system.inputs)
    return len(system.initial_state), 0


def outline_of(system: Any) -> Outline:
    """Return the outline of a valid node or object of the group `system`; a table is read.

    Raises:
        UserError: a table cannot be read.
        Exception: whatever the constructor of a user's own class raises.
    """
    system = OmegaConf.to_object(system) if isinstance(system, DictConfig) else system
    return _of_table(system) if isinstance(system, TableConfig) else _of_truth(cast(SystemConfig, system))


def _of_truth(system: SystemConfig) -> Outline:
    from eigenode_cli.config.build import build_system  # noqa: PLC0415  # NumPy, only for a line that is otherwise right

    states = tuple(state.name for state in build_system(system).states)
    known = states if system.initial_known is None else tuple(system.initial_known)
    return Outline(states, 0, tuple(system.observed), system.points, len(states) - len(known), 0)


def _of_table(system: TableConfig) -> Outline:
    from eigenode_cli.config.table import measured_of, roles_of  # noqa: PLC0415  # pandas

    measured, roles = measured_of(system), roles_of(system)
    trajectories, names = measured.training, roles.state_names
    half = roles.freedom
    observed = [names[number % len(names)] for number in roles.channels]
    if not roles.states:  # an acceleration gives its velocity, and either gives the position
        observed += [names[names.index(name) % half] for name in observed]
    return Outline(
        states=names,
        inputs=len(roles.inputs),
        observed=tuple(dict.fromkeys(observed)),
        points=max(one.trained for one in trajectories),
        unknown=len(names) * len(trajectories),
        offsets=sum(one.series.offsets.size for one in trajectories),
    )
