"""What becomes of an operator's wishes: steps, steps taken back, an episode that ends and is kept, the next one.

No thread and no clock: one call is one control step.
"""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from juicer.demonstration.claims import leads_to
from juicer.demonstration.correction import KEPT_AFTER_TOGGLE
from juicer.demonstration.log import MOST_STEPS
from juicer.episode import Outcome
from juicer.errors import DraftNotWritten, JuicerError, NotCorrectable, UnusableDraft
from juicer.geometry import rot6d_to_matrix, rotvec_to_matrix
from juicer.gripper import gripper_commands
from juicer.sim.env import STEP_S, AssemblyEnv
from juicer.teleoperation.choice import Choice
from juicer.teleoperation.controls import Intent
from juicer.teleoperation.drafts import Beginning, LeftDraft
from juicer.teleoperation.drivers import Driver
from juicer.teleoperation.key_maps import Action
from juicer.teleoperation.logs import Logs
from juicer.teleoperation.origin import Origin
from juicer.teleoperation.status import Phase
from juicer.teleoperation.take import Take

UNDO_STEPS = 10
IDLE_STEPS = 300
"""Steps without a wish after which the world stands still, so that nobody fills a log by thinking."""
STANDING_STEPS = 2
"""Steps that the arm is given to come to rest when the operator is gone."""
OPEN, CLOSE = -1.0, 1.0
_BRING_BACK = "Undo brings back what was discarded; to begin, let go of everything, then move"


class Ending(Enum):
    """Why an episode goes on no more."""

    KEPT = auto()
    """It is a success, and written."""
    NOT_WRITTEN = auto()
    """It is a success, but the disk refuses it."""
    FAILED = auto()
    """A part is lost, the simulation has diverged, or the log is full."""


_FAILURES = {
    Outcome.PART_LOST: "A part fell off the table",
    Outcome.DIVERGED: "The simulation broke down",
    Outcome.TIMEOUT: f"An episode ends {MOST_STEPS:,} steps after its reset",
}


class Work:
    """One operator's episodes of one task, one after the other.

    Attributes:
        choice: What is recorded.
        take: The episode in hand.
        ending: Why it goes on no more; None as long as it does.
        operator: Name of who drives now, for the logs.
        undo_s: Seconds that the longer undo takes back.
        time_scale: Simulated seconds a second, for the logs.
    """

    def __init__(self, choice: Choice, logs: Logs, origin: Origin | None = None) -> None:
        """Prepare the scene and begin the first episode.

        Args:
            choice: What is recorded.
            logs: Where it goes.
            origin: Step of a rollout from which every episode goes; from a reset, each to another seed, if None.

        Raises:
            ConfigError: If there is no such task or randomness.
            LogNotWritten: If the folder of the logs cannot be written.
            InvalidEpisode: If the origin's state is none of this scene.
            NotCorrectable: If the rollout's actions do not lead to it.
        """
        self.choice = choice
        self.logs = logs
        self._origin = origin
        self.operator = choice.operator
        self.undo_s = 5.0
        self.time_scale = 1.0
        self.env = AssemblyEnv(choice.task, choice.randomness, max_steps=MOST_STEPS)
        if origin:
            self._require_reachable(origin)
        self._dropped: Take | None = None
        self._begin(self._next_seed())

    def _require_reachable(self, origin: Origin) -> None:
        """Refuse before anybody works at it what could not be verified afterwards."""
        if origin.step >= MOST_STEPS:
            raise NotCorrectable(
                f"an episode ends {MOST_STEPS:,} steps after its reset, those of the rollout among them; choose an "
                f"earlier step than {origin.step:,}"
            )
        self.env.set_state(origin.state)
        if not leads_to(self.env, origin.seed, origin.actions, origin.state):
            raise NotCorrectable(
                f"the actions of rollout {origin.parent} no longer lead to its state at step {origin.step}, as it was "
                "made by another version of the simulator; collect rollouts anew"
            )

    def _next_seed(self) -> int:
        """A rollout is corrected as often as the operator likes; any other initial state is given once."""
        return self._origin.seed if self._origin else self.logs.next_seed()

    def _begin(self, seed: int, note: str = "") -> None:
        self.take = Take(self.env, seed, self._origin.state if self._origin else None)
        self._prepare(note)

    def _begin_draft(self) -> None:
        """The first step is about to be made."""
        choice, origin, take = self.choice, self._origin, self.take
        take.began, self._dropped = _now(), None
        beginning = Beginning(
            task=choice.task, randomness=choice.randomness, seed=take.seed, began=take.began,
            operator=self.operator, keys=choice.keys,
            parent=origin.parent if origin else None, parent_step=origin.step if origin else None,
            parent_actions=origin.actions.tolist() if origin else None,
        )  # fmt: skip
        self.logs.begin(beginning, take)

    def _add_driver(self, driver: Driver) -> None:
        if driver not in self.take.drivers:
            self.take.drivers.append(driver)
            self.logs.add_driver(driver)

    def _drop(self) -> None:
        """Nobody wants the episode in hand; :meth:`_bring_back` makes up for a slip."""
        if not len(self.take):
            self.logs.remove()
            return
        # What has diverged is in no state that could be restored.
        self._dropped = self.take if self.take.outcome is not Outcome.DIVERGED else None
        self.take.leave()
        self.logs.drop()

    def _bring_back(self, dropped: Take) -> None:
        dropped.come_back()
        self.take, self._dropped = dropped, None
        self.logs.bring_back()
        self._prepare(f"What was discarded is back, with its {len(dropped)} steps")
        if dropped.done:
            self._end()

    def resume(self, left: LeftDraft) -> None:
        """Go on with an episode that was interrupted, where it was; the one in hand must be a new one.

        Raises:
            UnusableDraft: If somebody else goes on with it, or it is of another task.
            DraftNotWritten: If the disk refuses that.
        """
        beginning = left.beginning
        if (beginning.task, beginning.randomness) != (self.choice.task, self.choice.randomness):
            raise UnusableDraft(f"draft '{left.path.name}' is of {beginning.task} at {beginning.randomness} randomness")
        take = Take(self.env, beginning.seed, left.state)
        resumed = left.resume(self.env, lambda action, idle: take.act(action, idle=idle))
        self.logs.go_on_with(left.take_up(resumed))
        self.take, take.began, take.drivers = take, beginning.began, list(left.drivers)
        lost = len(left.steps) - resumed
        self._prepare(
            f"Here you were interrupted, after {resumed} steps"
            + (f"; {lost} more could not be computed again by this version of the simulator" if lost else "")
        )
        if take.done:
            self._end()

    def _prepare(self, note: str) -> None:
        self.ending: Ending | None = None
        self._hold: NDArray[np.float64] | None = None
        self._gripper = OPEN
        self._toggled = False
        self._follow_gripper()
        self._grace = 0
        # What was held when an episode was dropped, by a slip perhaps, was not meant for the next one: its first step
        # would be the end of what was dropped.
        self._awaits_rest = False
        self._note = note
        self._paused = self._away = False
        self.acts = False
        self.slow = False

    @property
    def gripper_closes(self) -> bool:
        """Whether the gripper was told to close."""
        return self._gripper == CLOSE

    @property
    def _settling(self) -> int:
        """Steps that still belong to the last toggle of the gripper."""
        return max(KEPT_AFTER_TOGGLE - self._since_toggle, 0)

    def obey(self, presses: Collection[Action]) -> None:
        """Do what was asked for by single presses; what a disk refuses is said."""
        for action in Action:
            if action in presses:
                try:
                    self._obey(action)
                except JuicerError as error:
                    self._note = str(error)

    def _obey(self, action: Action) -> None:
        if self.ending is Ending.KEPT:
            return
        if action is Action.DISCARD:
            seed = self._next_seed()
            self._drop()
            begun = "the same step anew" if self._origin else "another initial state"
            self._begin(seed, f"Discarded; this is {begun}. {_BRING_BACK}")
            self._awaits_rest = True
        elif action is Action.RESET:
            self._drop()
            begun = "step" if self._origin else "initial state"
            self._begin(self.take.seed, f"The same {begun} anew. {_BRING_BACK}")
            self._awaits_rest = True
        elif action in (Action.UNDO, Action.UNDO_MORE):
            self._undo(UNDO_STEPS if action is Action.UNDO else round(self.undo_s / STEP_S))
        elif action is Action.SUCCESS:
            self._claim_success()
        elif self.ending is None:
            self._steer(action)

    def _steer(self, action: Action) -> None:
        if action is Action.PAUSE:
            self._paused, self._note = True, ""
        elif action is Action.PROCEED:
            self._paused, self._note = False, ""
        elif action is Action.GRIPPER and not (self._paused or self._settling or self._awaits_rest):
            self._gripper, self._toggled = -self._gripper, True

    def _claim_success(self) -> None:
        if self.ending is Ending.NOT_WRITTEN:
            self._keep()
        elif self.ending is None:
            self._note = (
                f"Not yet a success: {self.assembled} of {len(self.env.task.pairs)} pairs are assembled. "
                "A success is seen and saved by itself"
            )

    def _undo(self, steps: int) -> None:
        if not len(self.take) and self._dropped:
            self._bring_back(self._dropped)
            return
        undone = self.take.undo(steps)
        self._follow_gripper()
        self.ending, self._hold, self._toggled, self._grace = None, None, False, 0
        self.acts = False
        self._note = f"Took back {undone} steps" if undone else "There is nothing to take back"
        if undone:
            self.logs.take_back(undone)

    def _follow_gripper(self) -> None:
        """Know again what the gripper was told last, and when."""
        before = CLOSE if self.take.began_closed else OPEN
        commands = np.append(before, gripper_commands(self.take.actions))
        toggles = np.flatnonzero(np.diff(commands))
        self._gripper = float(commands[-1])
        self._since_toggle = len(self.take) - 1 - int(toggles[-1]) if len(toggles) else KEPT_AFTER_TOGGLE

    def step(self, intent: Intent, *, present: bool, source: str = "") -> bool:
        """One control step; False if the world stands still.

        Args:
            intent: What the operator wants.
            present: Whether somebody holds the controls.
            source: Kind of device that was heard of.
        """
        self._away, self.slow = not present, intent.slow
        if self.ending:
            return False
        self._awaits_rest = self._awaits_rest and intent.moves
        free = present and not (self._paused or self._awaits_rest)
        acts = free and (intent.moves or self._toggled)
        if acts:
            self._grace = IDLE_STEPS + 1
            self._note = ""
        elif not free:
            self._grace = min(self._grace, max(STANDING_STEPS, self._settling))
        self.acts = acts or self._settling > 0
        if self._grace == 0:
            self.acts = False
            return False
        self._grace -= 1
        self._since_toggle = 0 if self._toggled else self._since_toggle + 1
        self._toggled = False
        if not self.take.began:
            self._begin_draft()
        if acts:
            self._add_driver(Driver(self.operator, source or "keyboard", self.choice.keys, self.time_scale))
        self.take.act(self._action(intent if acts else Intent()), idle=not acts)
        try:
            self.logs.add(self.take)
        except DraftNotWritten as error:
            self._note = f"{error}; what you record is kept in memory only"
        if self.take.done:
            self._end()
        return True

    def _action(self, intent: Intent) -> NDArray[np.float64]:
        shown = self.take.observation["proprioception"].astype(np.float64)
        if intent.moves:
            twist = np.asarray(intent.twist) * STEP_S
            rotation = rotvec_to_matrix(twist[3:]) @ rot6d_to_matrix(shown[3:9])
            self._hold = None
            pose = np.concatenate([shown[:3] + twist[:3], rotation[:2].ravel()])
        else:
            # Where it was when the operator let go: holding the last target would lead on.
            self._hold = shown[:9] if self._hold is None else self._hold
            pose = self._hold
        action: NDArray[np.float64] = np.clip(np.append(pose, self._gripper), -1.0, 1.0)
        return action

    def _end(self) -> None:
        outcome = self.take.outcome
        if outcome is Outcome.SUCCESS:
            self._keep()
        elif outcome is not None:
            self.ending = Ending.FAILED
            among = f", the {self._origin.step:,} of the rollout among them" if self._origin else ""
            what = _FAILURES[outcome] + (among if outcome is Outcome.TIMEOUT else "")
            self._note = f"{what}: take steps back or discard the episode"

    def _keep(self) -> None:
        try:
            name = self.logs.keep(self.take.log(_now(), self._origin))
        except (JuicerError, OSError) as error:
            self.ending = Ending.NOT_WRITTEN
            self._note = f"Assembled, but {error}; as soon as you have made room it is saved, or discard it"
            return
        self.ending = Ending.KEPT
        self._note = f"Assembled, and written as {name}; it is being checked"

    def close(self) -> None:
        """Stop; what was recorded of the episode in hand stays on the disk."""
        if not len(self.take):
            self.logs.remove()
        self.logs.close()
        self.env.close()

    def go_on(self) -> None:
        """Begin the next episode, once the last one is kept; if the disk refused either, try again, and say so."""
        if self.ending is Ending.NOT_WRITTEN:
            self._keep()
        elif self.ending is Ending.KEPT:
            try:
                self._begin(self._next_seed())
            except JuicerError as error:
                self._note = f"The episode is saved, but no other can begin: {error}"

    @property
    def origin(self) -> str:
        """Where the episode in hand begins, in words."""
        origin = self._origin
        return f"step {origin.step} of rollout {origin.parent}" if origin else f"state {self.take.seed}"

    @property
    def assembled(self) -> int:
        """Pairs that are assembled."""
        return int(self.take.info.get("parts_assembled", self.take.assembled_before))

    @property
    def phase(self) -> Phase:
        """What becomes of the present moment."""
        if self.ending:
            return Phase.OVER
        if self._paused or self._away:
            return Phase.PAUSED
        return Phase.RECORDING if self.acts else Phase.IDLE

    @property
    def sentence(self) -> str:
        """The same for people, with what they may do about it."""
        if self._note:
            return self._note
        if self._paused:
            return "Paused by you; continue when you like"
        if self._away:
            return "Paused, as nothing is heard of the operator; click into the page and go on"
        if self.acts:
            return "Recording what you do"
        return "Nothing is recorded while you do nothing" if len(self.take) else "Recording begins when you move"


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")
