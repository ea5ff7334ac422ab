"""The live session: one thread owns physics, clock and recorder; others set the newest wish, read the newest moment."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.sim.env import STEP_S
from juicer.teleoperation.beat import Beat
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.inbox import Inbox
from juicer.teleoperation.status import Phase, Snapshot, Status
from juicer.teleoperation.work import Work

FRAME_S = 0.05
"""Between two moments that are shown."""
LAST_LOOK_S = 1.5
"""How long a success is looked at before the next episode begins."""
RETRY_S = 1.0
"""Between two tries to write what the disk refuses."""
SLOWEST, FASTEST = 0.25, 1.0
LONGEST_UNDO_S = 60.0

logger = logging.getLogger(__name__)


class Session:
    """Lets time pass for an operator's work, in a thread of its own."""

    def __init__(self, work: Work, first_number: int = 0) -> None:
        """Prepare; :meth:`start` lets time pass.

        Args:
            work: What the operator works at.
            first_number: Number of the first moment.
        """
        self._work = work
        self._inbox = Inbox(Controls())
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        now = time.monotonic()
        self._frames, self._steps = Beat(now), Beat(now)
        self._before: NDArray[np.float64] = work.env.data.qpos.copy()
        self._after = self._before
        self._stepped_at, self._goes_on_at = now, now + LAST_LOOK_S
        self._moved_by = -1
        self._time_scale, self._undo_s, self._operator = 1.0, work.undo_s, work.operator
        self._snapshot = self._look(now, first_number)

    def start(self) -> None:
        """Let time pass."""
        self._thread.start()

    def close(self) -> None:
        """Stop; what was recorded of the episode in hand stays on the disk."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        self._work.close()
        with self._changed:
            self._changed.notify_all()

    def take_over(self, controls: Controls, operator: str | None = None) -> None:
        """Somebody takes the controls; what was heard before counts no more.

        Args:
            controls: Turns what is heard into what is wanted.
            operator: Name of who drives from now on; it stays the same person if None.
        """
        if operator is not None:
            self._operator = operator
        self._inbox.take_over(controls)

    @property
    def operator(self) -> str:
        """Name of who drives."""
        return self._operator

    def hear(self, state: ControllerState) -> bool:
        """Take the newest state of the controller; False if it is a repeated or an overtaken one."""
        return self._inbox.put(state, time.monotonic())

    def release(self) -> None:
        """Nobody holds the controls: the arm comes to rest and recording pauses until somebody is heard again."""
        self._inbox.release()

    def pace(self, time_scale: float, undo_s: float) -> None:
        """Choose how fast time passes and what the longer undo takes back, each within its bounds."""
        self._time_scale = min(max(time_scale, SLOWEST), FASTEST)
        self._undo_s = min(max(undo_s, STEP_S), LONGEST_UNDO_S)

    @property
    def latest(self) -> Snapshot:
        """The newest moment."""
        return self._snapshot

    def newer(self, than: int, timeout_s: float) -> Snapshot | None:
        """The newest moment, as soon as there is one after that of a number; None if none comes in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._snapshot.number > than or self._closing.is_set(), timeout_s)
            return self._snapshot if self._snapshot.number > than else None

    def _run(self) -> None:
        try:
            while not self._closing.wait(max(0.0, min(self._frames.next_at, self._steps.next_at) - time.monotonic())):
                # Physics first: what is late costs frames, never steps.
                if self._steps.is_due(now := time.monotonic()):
                    self._step(now)
                if self._frames.is_due(now := time.monotonic()):
                    self._publish(self._look(now, self._snapshot.number + 1))
                    self._frames.wait(FRAME_S, now)
        except Exception:
            logger.exception("the simulation of a session failed")
            sentence = "The simulation failed, which is a defect of juicer; what was recorded is kept: begin again"
            status = replace(self._snapshot.status, phase=Phase.OVER, sentence=sentence)
            self._publish(replace(self._snapshot, number=self._snapshot.number + 1, status=status))

    def _step(self, now: float) -> None:
        work, heard = self._work, self._inbox.get(now)
        work.time_scale, work.undo_s, work.operator = self._time_scale, self._undo_s, self._operator
        work.obey(heard.intent.presses)
        if work.ending and now >= self._goes_on_at:
            work.go_on()
            self._goes_on_at = time.monotonic() + RETRY_S
        self._before = work.env.data.qpos.copy()
        moved = work.step(heard.intent, present=heard.present, source=heard.source)
        self._after = work.env.data.qpos.copy() if moved else self._before
        if moved:
            self._moved_by, self._stepped_at, self._goes_on_at = heard.sequence, now, now + LAST_LOOK_S
        # A world that stands still starts without waiting for a whole step.
        self._steps.wait(STEP_S / self._time_scale if moved else FRAME_S, now)

    def _look(self, now: float, number: int) -> Snapshot:
        work = self._work
        shown = work.take.observation
        return Snapshot(
            number=number,
            at_s=now,
            heard=self._inbox.sequence,
            moved_by=self._moved_by,
            task=work.choice.task,
            qpos=self._between(now),
            end_effector=shown["proprioception"][:3],
            status=self._status(),
            observation=dict(shown),
        )

    def _between(self, now: float) -> NDArray[np.float64]:
        """Joint positions on the way of the last step: physics is a step ahead of what is shown, and never waits."""
        share = min((now + FRAME_S - self._stepped_at) * self._time_scale / STEP_S, 1.0)
        shown: NDArray[np.float64] = self._after
        if share < 1.0:
            model, velocity = self._work.env.model, np.empty(self._work.env.model.nv)
            shown = self._before.copy()
            mujoco.mj_differentiatePos(model, velocity, 1.0, self._before, self._after)
            mujoco.mj_integratePos(model, shown, velocity, share)
        return shown

    def _status(self) -> Status:
        work, choice = self._work, self._work.choice
        return Status(
            phase=work.phase,
            sentence=work.sentence,
            task=choice.task,
            randomness=choice.randomness,
            operator=self._operator,
            keys=choice.keys,
            target=choice.target,
            time_scale=self._time_scale,
            undo_s=self._undo_s,
            seed=work.take.seed,
            origin=work.origin,
            step=len(work.take),
            acted=len(work.take) - sum(work.take.idle),
            assembled=work.assembled,
            pairs=len(work.env.task.pairs),
            gripper_closes=work.gripper_closes,
            slow=work.slow,
            demonstrations=work.logs.demonstrations,
            corrections=work.logs.corrections,
            checking=work.logs.checking,
            kept=work.logs.kept,
            folder=str(work.logs.folder),
        )

    def _publish(self, snapshot: Snapshot) -> None:
        with self._changed:
            self._snapshot = snapshot
            self._changed.notify_all()
