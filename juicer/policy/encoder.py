"""What every encoder has in common, and all encoders of a policy as one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from juicer.episode import SIMULATOR, ArraySpec
from juicer.errors import ConfigError
from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.config import TASK_KEY, PolicyConfig
from juicer.policy.members import EncoderConfig
from juicer.policy.tasks import PART_POSES, Tasks
from juicer.views import ImageSpec, account_of

PROPRIOCEPTION = SIMULATOR["proprioception"]

Part = Tensor | Mapping[str, Tensor]
"""What one encoder has prepared: a tensor, or several by names of its own."""

Prepared = Mapping[str, Tensor]
"""What each encoder of a policy has prepared, by the encoder's name; of one that prepares several tensors, each by
``encoder.name``. So whoever takes rows of it need not know the encoders."""


class ObservationEncoder(nn.Module, ABC):
    """Encodes observations in steps, so that what needs no gradient is computed once for a whole dataset.

    What a frozen network makes of images is a column, derived once for all trainings; what has no weights is prepared
    once for a training; the rest is learned. A policy that acts takes all of these steps at once.

    It is built with its configuration, the tasks of the policy, and T_o.

    Attributes:
        observations: What it sees when the policy acts; a size that depends on the task may be None.
        token_size: Number K and length C of its tokens.
        begins_with_proprioception: Whether what it prepares begins with the normalised proprioception.
        is_taught_poses: Whether true poses of parts have taught it to read images.
    """

    observations: tuple[ArraySpec, ...]
    token_size: tuple[int, int]
    begins_with_proprioception: ClassVar[bool] = False
    is_taught_poses: ClassVar[bool] = False

    @property
    def training_observations(self) -> tuple[ArraySpec, ...]:
        """What it is shown in training: what it sees, with the columns that it derives in place of their origins."""
        return self.observations

    def take_estimators(self, folders: Sequence[Path]) -> None:
        """Take the estimators that it needs; most encoders need none.

        Raises:
            ConfigError: If one is not in any of the folders.
            InvalidCheckpoint: If a folder holds no estimator, or a damaged one.
        """

    @abstractmethod
    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Learn limits from :attr:`training_observations` ``(..., *shape)`` of the windows, images left out."""

    def derive(self, observations: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
        """The columns among :attr:`training_observations`, ``(..., *shape)``, of what it sees; most have none."""
        return {}

    @abstractmethod
    def prepare(self, observations: Mapping[str, Tensor]) -> Part:
        """What has no weights: ``(..., *prepared shape)`` of :attr:`training_observations` ``(..., *shape)``, by rows.

        What it takes as it is, such as images, it returns without a copy.
        """

    @abstractmethod
    def forward(self, prepared: Any) -> Tensor:
        """The learned part: tokens ``(B, K, C)`` of rows ``(B, T_o, ...)`` of what :meth:`prepare` returns."""


def build_encoder(config: EncoderConfig, tasks: Tasks, obs_horizon: int) -> ObservationEncoder:
    """The encoder of a configuration."""
    encoder: ObservationEncoder = config.network_class()(config, tasks, obs_horizon)
    return encoder


class Encoders(nn.Module):
    """All encoders of a policy; of a policy for several tasks, a learned embedding tells the task.

    Attributes:
        names: What the encoders are called.
        observations: What all of them see, and proprioception, in whose frame actions are given.
        training_observations: What they are shown in training.
        training_images: The images among that.
        training_numbers: The rest of it.
        sizes: Sizes of the condition that they yield.

    Raises:
        ConfigError: If two of them see the same observation in different shapes.
    """

    def __init__(self, config: PolicyConfig, tasks: Tasks) -> None:
        super().__init__()
        self.names = tuple(config.observation)
        # A list, since names of a ModuleDict's entries would have to differ from those of its methods.
        self.members = nn.ModuleList(
            build_encoder(each, tasks, config.horizons.obs) for each in config.observation.values()
        )
        self.observations = _declared(encoder.observations for _, encoder in self.items())
        self.training_observations = _declared(encoder.training_observations for _, encoder in self.items())
        self.training_images = tuple(spec for spec in self.training_observations if isinstance(spec, ImageSpec))
        self.training_numbers = tuple(spec for spec in self.training_observations if not isinstance(spec, ImageSpec))
        self.embedding = nn.Embedding(len(tasks), config.task_embedding) if len(tasks) > 1 else None
        self.sizes: ConditionSizes = {name: encoder.token_size for name, encoder in self.items()}
        if self.embedding is not None:
            self.sizes = {**self.sizes, TASK_KEY: (1, config.task_embedding)}

    def items(self) -> Iterator[tuple[str, ObservationEncoder]]:
        """Every encoder and its name."""
        for name, encoder in zip(self.names, self.members, strict=True):
            assert isinstance(encoder, ObservationEncoder)
            yield name, encoder

    @property
    def sees_images(self) -> bool:
        """Whether the policy is shown images when it acts."""
        return any(isinstance(spec, ImageSpec) for spec in self.observations)

    @property
    def account(self) -> str:
        """What the policy sees, and what it was taught with that it does not see: a result is never told without it.

        E.g. ``state``, ``images``, or ``images, poses in training``.
        """
        seen = account_of(self.observations)
        return f"{seen}, poses in training" if self.is_taught_unseen_poses else seen

    @property
    def is_taught_unseen_poses(self) -> bool:
        """Whether true poses have taught some of it that are not shown when the policy acts."""
        taught = any(encoder.is_taught_poses for _, encoder in self.items())
        return taught and PART_POSES not in {spec.name for spec in self.observations}

    def take_estimators(self, folders: Sequence[Path]) -> None:
        """See :class:`ObservationEncoder`."""
        for _, encoder in self.items():
            encoder.take_estimators(folders)

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """See :class:`ObservationEncoder`."""
        for _, encoder in self.items():
            encoder.fit(observations)

    def prepare(self, observations: Mapping[str, Tensor]) -> Prepared:
        """What every encoder prepares of observations ``(..., *shape)``, and the number of the task."""
        derived = {name: column for _, each in self.items() for name, column in each.derive(observations).items()}
        return self.prepare_training({**observations, **derived})

    def prepare_training(self, observations: Mapping[str, Tensor]) -> Prepared:
        """The same of what they are shown in training."""
        prepared: dict[str, Tensor] = {}
        for name, encoder in self.items():
            # Images that lie outside the memory are not touched for an encoder that sees none.
            shown = [*(spec.name for spec in encoder.training_observations), TASK_KEY]
            part = encoder.prepare({each: observations[each] for each in shown if each in observations})
            prepared |= {name: part} if isinstance(part, Tensor) else {f"{name}.{key}": part[key] for key in part}
        return prepared if self.embedding is None else {**prepared, TASK_KEY: observations[TASK_KEY]}

    def forward(self, prepared: Prepared) -> Condition:
        """Condition of prepared rows ``(B, T_o, ...)``."""
        condition = {name: encoder(_part(prepared, name)) for name, encoder in self.items()}
        if self.embedding is None:
            return condition
        return {**condition, TASK_KEY: self.embedding(prepared[TASK_KEY][:, -1].long())}


def outline(config: PolicyConfig, tasks: Tasks) -> Encoders:
    """Encoders without memory behind their weights, to ask what they see and are shown."""
    with torch.device("meta"):
        return Encoders(config, tasks)


def _part(prepared: Prepared, name: str) -> Part:
    """What the encoder of a name has prepared."""
    prefix = f"{name}."
    several = {key.removeprefix(prefix): value for key, value in prepared.items() if key.startswith(prefix)}
    return several or prepared[name]


def _declared(observations: Iterable[tuple[ArraySpec, ...]]) -> tuple[ArraySpec, ...]:
    found = {PROPRIOCEPTION.name: PROPRIOCEPTION}
    for spec in chain.from_iterable(observations):
        if found.setdefault(spec.name, spec) != spec:
            raise ConfigError(
                f"two encoders of a policy see '{spec.name}' in different shapes or types: "
                f"{found[spec.name].shape} {found[spec.name].dtype} and {spec.shape} {spec.dtype}"
            )
    return tuple(found.values())
