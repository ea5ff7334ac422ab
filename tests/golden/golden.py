"""What juicer computes for fixed seeds: recordings, corrective snippets, losses and evaluations, in a few words each.

Physics and learning are exact only within one environment: another library, processor or C library may round
otherwise. So each case says which libraries its value depends on.
"""

from __future__ import annotations

import hashlib
import platform
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from juicer.annotation.annotate import annotate
from juicer.annotation.propose import AnnotationConfig
from juicer.augmentation.augment import FailedAttempt, Snippet, augment
from juicer.augmentation.config import AugmentationConfig
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.episode import Episode, EpisodeRecord
from juicer.expert.operator import scripted_operators
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.feature_spec import feature_spec
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.replay import ReplayPolicy
from juicer.rollout import Policy, rollout
from juicer.seed_ranges import Purpose, claim
from juicer.storage.annotations import Annotation
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.training.config import PhysicalStateNoise, TrainingConfig, WindowConfig
from juicer.training.trainer import TrainedCheckpoint, train
from juicer.training.windows import TrainingEpisodes

TASK = "one_leg"
"""What is learned and evaluated."""
DEMONSTRATIONS = range(3)
SNIPPETS = 12
CHUNK = 5
"""Episodes an evaluation case."""
MAX_STEPS = 400
"""Steps an episode of an evaluation: a success takes about 330."""

PHYSICS = ("mujoco", "numpy")
LEARNING = (*PHYSICS, "torch")
EXTENSIONS = ("fma", "avx2", "avx512f", "avx512_bf16", "amx_tile", "amx_fp16")
"""Of x86; by these and the vendor, the libraries choose their ways to add and multiply."""

SMALL = DiffusionConfig(
    denoiser=MLPDenoiserConfig(width=256, blocks=2), prediction="sample", inference_steps=2, spacing="trailing"
)
POLICIES: Mapping[str, PolicyConfig] = {
    "diffusion": PolicyConfig(
        horizons=HorizonConfig(pred=16, action=8), action_frame="relative", action_limits="per_step", head=SMALL
    ),
    "unet": PolicyConfig(
        horizons=HorizonConfig(obs=2, pred=16, action=8),
        head=DiffusionConfig(denoiser=UNetConfig(channels=(32, 64, 64), step_embedding=32)),
    ),
    "mlp chunked": PolicyConfig(horizons=HorizonConfig(pred=16, action=8), head=MLPHeadConfig(width=128, blocks=2)),
    "mlp unchunked": PolicyConfig(
        horizons=HorizonConfig(pred=1, action=1), action_frame="relative", head=MLPHeadConfig(width=128, blocks=2)
    ),
}
TRAINING = TrainingConfig(
    steps=50,
    batch_size=128,
    learning_rate=3e-3,
    warmup_steps=10,
    ema_decay=0.99,
    windows=WindowConfig(back_padding=15, learn_padding=False),
    state_noise=PhysicalStateNoise(),
    validation_fraction=0.3,
    validate_every=25,
    report_every=1,
)
LONG_TRAINING = TRAINING.model_copy(update={"steps": 1200, "state_noise": None, "validation_fraction": 0.0})
"""Long enough for a policy that assembles now and then."""


@dataclass(frozen=True)
class Case:
    """A value that must not drift.

    Attributes:
        compute: Gives the value, which JSON can hold exactly.
        libraries: Whose versions it depends on.
        slow: Whether it is left out of the quick tests.
    """

    compute: Callable[[], Any]
    libraries: Sequence[str] = PHYSICS
    slow: bool = False

    @property
    def environment(self) -> str:
        """Within which its value is exact."""
        # Since Python 3.12, sum() adds floating-point numbers otherwise.
        python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
        libraries = [f"{name} {version(name)}" for name in self.libraries]
        return ", ".join([python, *libraries, " ".join(platform.libc_ver()), processor(), blas()])


def processor() -> str:
    """Architecture, vendor and vector extensions of this machine's processor."""
    path = Path("/proc/cpuinfo")
    facts = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line) if path.exists() else {}
    told = {name.strip(): value.split() for name, value in facts.items()}
    extensions = [name for name in EXTENSIONS if name in told.get("flags", [])]
    return " ".join([platform.machine(), *told.get("vendor_id", []), *extensions])


def blas() -> str:
    """The library behind NumPy's matrix products, with the kernels that it chose, e.g. ``openblas SkylakeX``.

    Two processors with the same extensions may be given different ones: OpenBLAS takes a processor that is newer than
    itself for an older one.
    """
    # Others come with SciPy, once something imports it.
    found = [each for each in threadpool_info() if each["user_api"] == "blas" and "numpy" in each["filepath"]]
    return " ".join(f"{each['internal_api']} {each.get('architecture', '')}" for each in found)


def digest(values: np.ndarray[Any, Any]) -> str:
    """SHA-256 of an array: its type, its shape, every bit."""
    content = f"{values.dtype.str} {values.shape} ".encode() + np.ascontiguousarray(values).tobytes()
    return hashlib.sha256(content).hexdigest()


@cache
def recording(task: str, seed: int) -> OperatorLog:
    """What the recorder hands to ingestion: idle steps are still in it."""
    (log,) = recordings(task, "low", claim(Purpose.DEMONSTRATIONS, seed, 1), scripted_operators(0))
    return log


def describe_recording(task: str, seed: int) -> dict[str, Any]:
    """Every action and every simulator state of a recording, and how it ended."""
    log = recording(task, seed)
    return {
        "outcome": str(log.outcome),
        "steps": len(log),
        "actions": digest(log.steps["action"]),
        "states": digest(log.steps["sim_state"]),
        "final state": digest(log.final["sim_state"]),
    }


class Demonstrations(list[Episode]):
    """Episodes by number, in memory."""

    @property
    def records(self) -> list[EpisodeRecord]:
        """Facts about every episode."""
        return [episode.record for episode in self]

    def read(self, index: int) -> Episode:
        """The episode of a number."""
        return self[index]


@cache
def demonstrations(task: str, seeds: Iterable[int]) -> Demonstrations:
    """Recordings as ingestion keeps them."""
    ingestion = Ingestion(IngestionConfig(task=task))
    return Demonstrations(ingestion.ingest_log(recording(task, seed)).episode for seed in seeds)


def attempts(
    episodes: Demonstrations, annotations: Sequence[Annotation], num_snippets: int
) -> list[Snippet | FailedAttempt]:
    """Snippets and refusals in their order, until there are as many snippets as wanted."""
    config = AugmentationConfig(num_snippets=num_snippets)
    return list(augment(episodes, annotations, config, seed=0, num_workers=1))


def describe_snippets(task: str) -> list[Any]:
    """For each critical state of a demonstration: where it is, and what becomes of the attempts at one snippet."""
    episodes = demonstrations(task, range(1))
    return [
        {
            "critical state": found.critical_state,
            "step": found.step,
            "confidence": found.confidence.hex(),
            "attempts": [describe_attempt(attempt) for attempt in attempts(episodes, [found], 1)],
        }
        for found in annotate(episodes, AnnotationConfig(), num_workers=1)
    ]


def describe_attempt(attempt: Snippet | FailedAttempt) -> Any:
    """Every action and every simulator state of a snippet, or why there is none."""
    if isinstance(attempt, FailedAttempt):
        return f"{attempt.departure}: {attempt.reason}"
    steps = attempt.episode.steps
    return {
        "departure": attempt.departure,
        "steps": len(attempt.episode),
        "actions": digest(steps["action"]),
        "states": digest(steps["sim_state"]),
    }


@cache
def training_data() -> TrainingEpisodes:
    """Demonstrations of one task, and snippets grown from them."""
    episodes = demonstrations(TASK, DEMONSTRATIONS)
    annotations = list(annotate(episodes, AnnotationConfig(), num_workers=1))
    snippets = [made.episode for made in attempts(episodes, annotations, SNIPPETS) if isinstance(made, Snippet)]
    both = [*episodes, *snippets]
    families = {episode.record.episode_id: f"golden/{index}" for index, episode in enumerate(episodes)}
    return TrainingEpisodes(
        observations={
            name: np.concatenate([episode.steps[name] for episode in both]).astype(np.float32)
            for name in ("proprioception", "part_poses")
        },
        actions=np.concatenate([episode.steps["action"] for episode in both]).astype(np.float32),
        episode_ends=np.cumsum([len(episode) for episode in both], dtype=np.int64),
        families=[*families.values(), *(families[str(snippet.record.parent)] for snippet in snippets)],
        sources=[str(episode.record.source) for episode in both],
    )


class Curves:
    """Keeps what a training reports, to the last digit."""

    def __init__(self) -> None:
        self.points: dict[str, list[str]] = {}

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Take values of a step."""
        for name, value in metrics.items():
            if name != "train/learning_rate":  # a function of the step alone, and the losses follow from it
                self.points.setdefault(name, []).append(float(value).hex())


def trained(name: str, config: TrainingConfig, curves: Curves | None = None) -> TrainedCheckpoint:
    """A policy that has learned from :func:`training_data`."""
    if POLICIES[name].horizons.pred == 1:
        config = config.model_copy(update={"windows": WindowConfig(back_padding=0)})
    return train([training_data()], POLICIES[name], {TASK: feature_spec(TASK)}, config, seed=0, metrics=curves)


def describe_training(name: str) -> dict[str, list[str]]:
    """The loss of every step, and what was validated."""
    curves = Curves()
    trained(name, TRAINING, curves)
    return curves.points


@cache
def trained_policy() -> Policy:
    """A network that assembles now and then."""
    return trained("diffusion", LONG_TRAINING).checkpoint.policy(TASK)


@cache
def replay_policy() -> Policy:
    """The policy that learns nothing: it plays what it remembers."""
    task, episodes = get_task(TASK), demonstrations(TASK, DEMONSTRATIONS)
    parts = sorted({part for pair in task.pairs for part in (pair.first, pair.second)})
    first_poses = np.stack([episode.steps["part_poses"][0] for episode in episodes]).astype(np.float32)
    actions = [episode.steps["action"].astype(np.float32) for episode in episodes]
    return ReplayPolicy(first_poses, actions, parts, task.max_steps)


def describe_evaluation(policy: Callable[[], Policy], first: int) -> list[dict[str, Any]]:
    """How a policy does from initial states that belong to evaluation."""
    seeds = claim(Purpose.EVALUATION, first, CHUNK)
    return [
        {
            "outcome": str(episode.record.outcome),
            "parts assembled": episode.record.parts_assembled,
            "steps": len(episode),
            "final state": digest(episode.final["sim_state"]),
        }
        for episode in rollout(policy(), TASK, "low", seeds, num_envs=2, max_steps=MAX_STEPS)
    ]


def _cases() -> dict[str, Case]:
    cases = {
        f"recording of {task}, seed {seed}": Case(
            partial(describe_recording, task, seed), slow=seed > 0 and task != TASK
        )
        for task in TASK_NAMES
        for seed in range(3)
    }
    cases |= {f"snippets of {task}": Case(partial(describe_snippets, task)) for task in TASK_NAMES}
    cases |= {f"training of {name}": Case(partial(describe_training, name), LEARNING) for name in POLICIES}
    # The quick ones are those in which either policy succeeds once.
    for first in (0, CHUNK):
        states = f"states {first} to {first + CHUNK - 1}"
        replayed, learned = (partial(describe_evaluation, policy, first) for policy in (replay_policy, trained_policy))
        cases[f"evaluation of a replay, {states}"] = Case(replayed, slow=first == 0)
        cases[f"evaluation of a trained policy, {states}"] = Case(learned, LEARNING, slow=first == 0)
    return cases


CASES: Mapping[str, Case] = _cases()
