"""The artifact store: find, create, open, and follow where artifacts come from."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from juicer.artifacts.draft import Draft
from juicer.artifacts.integrity import describe_files
from juicer.artifacts.local import LocalStore, delete_tree
from juicer.artifacts.manifest import Manifest, describe_host, plain, timestamp
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import KINDS, ArtifactRef
from juicer.artifacts.writing import explained
from juicer.errors import ArtifactNotFound, DamagedArtifact, WrongArtifactKind, did_you_mean

logger = logging.getLogger(__name__)


@dataclass(frozen=True, init=False)
class ArtifactStore:
    """Immutable artifacts, each under the id of its recipe. Cheap to pickle: it holds only where it is."""

    url: str

    def __init__(self, url: str | Path) -> None:
        """Point at a store.

        Args:
            url: Local folder; it is created with the first artifact.
        """
        object.__setattr__(self, "url", str(Path(url).absolute()))

    @property
    def _local(self) -> LocalStore:
        return LocalStore(Path(self.url))

    def find(self, recipe: Recipe) -> ArtifactRef | None:
        """The artifact that the recipe makes, if it was made before."""
        return recipe.ref if self._local.exists(recipe.ref) else None

    @contextmanager
    def create(self, recipe: Recipe) -> Iterator[Draft]:
        """Make the artifact of a recipe: fill the draft inside the block, it is committed at the end of the block.

        At a failure, or a kill at any moment, the artifact is absent. Whoever needs an id that is being made
        waits, and then gets a draft that is ``adopted``.

        Raises:
            StoreNotWritable: If the disk refuses a write, in the block or at the commit.
        """
        local, ref = self._local, recipe.ref
        with explained(local.root), local.lock(ref.id):
            if local.exists(ref):
                yield Draft(ref, local.folder(ref), local.scratch(ref.id), adopted=True)
                return
            delete_tree(local.draft(ref.id))
            local.sweep()
            draft = Draft(ref, local.draft(ref.id), local.scratch(ref.id))
            draft.path.mkdir(parents=True)
            draft.scratch.mkdir(parents=True, exist_ok=True)
            started, clock = datetime.now(), time.monotonic()
            try:
                yield draft
                manifest = Manifest(
                    recipe=recipe,
                    files=describe_files(draft.path),
                    summary=plain(draft.summary),
                    host=describe_host(),
                    started=timestamp(started),
                    finished=timestamp(datetime.now()),
                    seconds=round(time.monotonic() - clock, 3),
                )
                local.commit(draft.path, manifest)
            except BaseException:
                delete_tree(draft.path)
                if not any(draft.scratch.iterdir()):
                    draft.scratch.rmdir()
                raise
            delete_tree(draft.scratch)

    def open(self, ref: ArtifactRef, kind: str | None = None) -> Path:
        """Folder of an artifact, after every file was found to be as it was written.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            WrongArtifactKind: If ``kind`` is given and is not its kind.
            DamagedArtifact: If a file is missing, altered or does not belong to it.
        """
        self._check_kind(ref, kind)
        if problems := self.verify(ref):
            raise self._damaged(ref, problems[0])
        return self._local.folder(ref)

    def manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of an artifact.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            DamagedArtifact: If its manifest is missing or altered.
        """
        self._require(ref)
        try:
            return self._local.read_manifest(ref)
        except ValueError as error:
            raise self._damaged(ref, str(error)) from None

    def refs(self, kind: str | None = None) -> Sequence[ArtifactRef]:
        """Every artifact, of one kind or of all, damaged or not."""
        return self._local.refs(kind)

    def list(self, kind: str | None = None) -> Sequence[Manifest]:
        """Descriptions of every artifact, oldest first; one whose manifest is damaged is logged and left out."""
        manifests = []
        for ref in self.refs(kind):
            try:
                manifests.append(self.manifest(ref))
            except DamagedArtifact as error:
                logger.warning("%s", error)
        return sorted(manifests, key=lambda manifest: (datetime.fromisoformat(manifest.finished), manifest.ref))

    def resolve(self, text: str, kind: str | None = None) -> ArtifactRef:
        """The one artifact meant by an id, the beginning of an id, or ``kind/id``.

        Raises:
            ArtifactNotFound: If none or several answer to the text.
            WrongArtifactKind: If ``kind`` is given and the artifact is of another kind.
        """
        stated, separator, prefix = text.strip().rpartition("/")
        if separator and stated not in KINDS:
            raise ArtifactNotFound(f"'{text}' names no kind of artifact{did_you_mean(stated, KINDS)}")
        matches = [ref for ref in self.refs(stated or None) if prefix and ref.id.startswith(prefix)]
        # A prefix may be shared by several kinds; the kind that is needed then decides.
        wanted = [ref for ref in matches if kind in (None, ref.kind)] or matches
        if not wanted:
            raise ArtifactNotFound(f"no artifact answers to '{text}' in '{self.url}'; list them with `juicer ls`")
        if len(wanted) > 1:
            raise ArtifactNotFound(f"'{text}' is short for {', '.join(map(str, wanted))}; give more digits")
        self._check_kind(wanted[0], kind)
        return wanted[0]

    def verify(self, ref: ArtifactRef) -> Sequence[str]:
        """Problems of an artifact, one clause each that names the file; none if it is whole.

        Raises:
            ArtifactNotFound: If there is no such artifact.
        """
        self._require(ref)
        return self._local.problems(ref)

    def lineage(self, ref: ArtifactRef) -> Sequence[ArtifactRef]:
        """Every ancestor once, parents before children; ancestors that were discarded are named but end their line."""
        order: dict[ArtifactRef, None] = {}

        def visit(child: ArtifactRef) -> None:
            for parent in self.manifest(child).recipe.parents:
                if parent not in order:
                    if self._local.exists(parent):
                        visit(parent)
                    order[parent] = None

        visit(ref)
        return list(order)

    def descendants(self, ref: ArtifactRef) -> Sequence[ArtifactRef]:
        """Every artifact made from this one, directly or not, parents before children."""
        reached = {ref}
        order = []
        remaining = self.list()
        while fresh := [manifest for manifest in remaining if reached.intersection(manifest.recipe.parents)]:
            order += [manifest.ref for manifest in fresh]
            reached.update(order)
            remaining = [manifest for manifest in remaining if manifest.ref not in reached]
        return order

    def discard(self, ref: ArtifactRef) -> None:
        """Delete an artifact, whole or damaged; what was made from it stays.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            StoreNotWritable: If the disk refuses.
        """
        self._require(ref)
        with explained(self._local.root), self._local.lock(ref.id):
            self._local.remove(ref)

    def _require(self, ref: ArtifactRef) -> None:
        if not self._local.exists(ref):
            raise ArtifactNotFound(f"artifact {ref} does not exist in '{self.url}'; see `juicer ls {ref.kind}`")

    @staticmethod
    def _check_kind(ref: ArtifactRef, kind: str | None) -> None:
        if kind not in (None, ref.kind):
            raise WrongArtifactKind(
                f"{ref} is of kind '{ref.kind}' but '{kind}' is needed here; see `juicer ls {kind}`"
            )

    @staticmethod
    def _damaged(ref: ArtifactRef, problem: str) -> DamagedArtifact:
        return DamagedArtifact(f"artifact {ref} is damaged: {problem}; recompute it with `juicer repair {ref.id}`")
