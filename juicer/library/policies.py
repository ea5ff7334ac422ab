"""Policies out of a store, and what a policy says that it sees."""

from __future__ import annotations

from typing import TYPE_CHECKING

from juicer.errors import ConfigError

if TYPE_CHECKING:
    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore
    from juicer.rollout import Policy


def load_policy(store: ArtifactStore, ref: ArtifactRef, task: str | None, device: str, max_steps: int | None) -> Policy:
    """See :func:`juicer.api.load_policy`; it knows what its weights were taught with, which only the manifest says."""
    from juicer.policy import checkpoint
    from juicer.sim.arguments import checked_count

    if max_steps is not None:
        max_steps = checked_count("max_steps", max_steps)
    manifest = store.manifest(ref)
    if task is None:
        known = manifest.summary.get("tasks", ())
        if not isinstance(known, list) or len(known) != 1:
            raise ConfigError(f"{ref} was trained for {len(known)} tasks ({', '.join(map(str, known))}); choose one")
        task = str(known[0])
    policy = checkpoint.load_policy(store.open(ref), task, max_steps, device)
    policy.observes = manifest.observes or policy.observes
    return policy


def observed_by(policy: object) -> str:
    """What a policy sees, e.g. ``state`` or ``images``, and what it was taught with beside if it says so itself."""
    from juicer.observer import STATE_OBSERVATIONS
    from juicer.views import account_of

    return str(getattr(policy, "observes", "") or account_of(getattr(policy, "observations", STATE_OBSERVATIONS)))
