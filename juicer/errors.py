"""Exceptions that tell a user what was wrong, where, and how to mend it.

Every mistake a user can make raises a subclass of :class:`JuicerError`; the command line prints its
message as one sentence and exits with a non-zero status. Anything else that escapes is a defect.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class JuicerError(Exception):
    """Root of every error whose message is meant for a user."""


class ConfigError(JuicerError):
    """A configuration value or key is wrong."""


class InvalidAction(JuicerError, ValueError):
    """An action is not finite, has the wrong shape or encodes no rotation, or there is no state to act on."""


class ArtifactError(JuicerError):
    """An artifact cannot be found, read or written."""


class ArtifactNotFound(ArtifactError):
    """No artifact answers to an id."""


class WrongArtifactKind(ArtifactError):
    """An artifact exists but is of another kind than the one needed."""


class DamagedArtifact(ArtifactError):
    """The files of an artifact differ from its manifest."""


class StrayFile(ArtifactError):
    """A file lies in an artifact that does not belong to it; the artifact itself is whole."""


class UnreadableArtifact(ArtifactError):
    """An artifact that may be whole, or the folder it may be in, cannot be looked at."""


class StoreNotWritable(ArtifactError):
    """The artifact store refuses a write (permission, full disk, read-only file system)."""


class StoreUnreachable(ArtifactError):
    """An artifact store beyond the network does not answer, or is too busy to; later it may."""


class InvalidEpisode(JuicerError, ValueError):
    """The arrays of an episode contradict each other."""


class EvaluationOnly(JuicerError):
    """Something is to be learned from an episode that is for evaluation only."""


class NotCorrectable(JuicerError):
    """An operator cannot go on from a step of an episode."""


class StateMissing(JuicerError):
    """Something needs an episode's simulator states, and the episode has none."""


class RejectedLog(JuicerError):
    """An operator log cannot be turned into a demonstration; the message is the reason."""


class LogNotWritten(JuicerError, OSError):
    """An operator log cannot be written; made of ``errno``, reason and path, as every refusal of a disk."""

    def __str__(self) -> str:
        return f"log '{self.filename}' cannot be written: {self.strerror}" if self.filename else super().__str__()


class RefusedMessage(JuicerError):
    """A message of a teleoperation device is none, or cannot follow those before it."""


class DeviceUnavailable(JuicerError):
    """A teleoperation device cannot be read on this machine."""


class DraftNotWritten(JuicerError, OSError):
    """The episode in hand cannot be written; made of ``errno``, reason and path, as every refusal of a disk."""

    def __str__(self) -> str:
        return f"the episode in hand is in memory only, as '{self.filename}' cannot be written: {self.strerror}"


class UnusableDraft(JuicerError):
    """What was recorded of an episode cannot be taken up again."""


class InvalidLabels(JuicerError):
    """A file of critical states labelled by hand contradicts itself or the episodes."""


class AnnotationConflict(JuicerError):
    """Somebody annotated a critical state after it was last looked at."""


class AnnotationsNotSaved(JuicerError):
    """The disk refuses what somebody said about critical states."""


class NothingLeft(JuicerError):
    """A stage has no data to work on: every log rejected, or no rollout succeeded."""


class RenderingUnavailable(JuicerError):
    """No OpenGL platform can draw an image on this machine."""


class TrackingError(JuicerError):
    """The tracking database cannot be used."""


class InvalidObservation(JuicerError, ValueError):
    """A policy is shown something it was not built for."""


class PolicyFailed(JuicerError):
    """A policy that a user wrote fails when it is asked for actions, or is none at all."""


class InvalidCheckpoint(JuicerError):
    """A checkpoint folder is incomplete, damaged or of another format."""


class UnusableWeights(JuicerError):
    """A file of pretrained weights is missing, or is not what it should be."""


class TrainingFailed(JuicerError):
    """Training cannot start from its data, or its loss is no longer a number."""


class ServiceUnavailable(JuicerError):
    """A server cannot be started or does not answer."""


class ForeignCode(JuicerError):
    """A process would run other code than the one that the identity of its artifact covers."""


class StageDied(JuicerError):
    """The process of a stage ended before its work was done."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Tail of an error message: the nearest valid word, or all of them.

    Returns:
        ``"; did you mean 'x'?"``, or ``"; valid: a, b, c"`` when nothing is near.
    """
    known = sorted(known)
    # Comparing words takes longer than they are long.
    nearest = get_close_matches(word[:100], known, n=1)
    return f"; did you mean '{nearest[0]}'?" if nearest else f"; valid: {', '.join(known)}"
