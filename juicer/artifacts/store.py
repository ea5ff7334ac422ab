"""The artifact store: find, create, open, and follow where artifacts come from."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from juicer.artifacts.backend import Backend, read_manifest
from juicer.artifacts.draft import Draft
from juicer.artifacts.findings import Finding, Listing, Nature, TroubleError
from juicer.artifacts.integrity import describe_files
from juicer.artifacts.lineage import parents_first
from juicer.artifacts.local import LocalBackend
from juicer.artifacts.manifest import CPU_SECONDS, Manifest, describe_host, plain
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ID_LENGTH, KINDS, ArtifactRef, is_id
from juicer.artifacts.workspace import delete_tree, discard_tree
from juicer.artifacts.writing import explained
from juicer.errors import (
    ArtifactError,
    ArtifactNotFound,
    DamagedArtifact,
    StrayFile,
    UnreadableArtifact,
    WrongArtifactKind,
    did_you_mean,
)
from juicer.text import printable

logger = logging.getLogger(__name__)


@dataclass(frozen=True, init=False)
class ArtifactStore:
    """Immutable artifacts, each under the id of its recipe. Cheap to pickle: it holds only where it is.

    Attributes:
        url: Absolute path of a local folder, or a URL such as ``s3://bucket/prefix``.
        cache: Local folder for work in progress and verified copies; a local store is its own.
    """

    url: str
    cache: Path

    def __init__(self, url: str | Path, cache: Path | None = None) -> None:
        """Point at a store; a folder is created with its first artifact.

        Args:
            url: Local folder, or any URL that fsspec understands; credentials come from the environment.
            cache: For a URL, where local copies go; by default a folder in the user's cache.
        """
        url = str(url).removeprefix("file://")
        if "://" in url:
            name = hashlib.sha256(url.encode()).hexdigest()[:16]
            cache = cache or Path.home() / ".cache" / "juicer" / name
        else:
            url = str(Path(url).expanduser().absolute())
            cache = Path(url)
        object.__setattr__(self, "url", url)
        object.__setattr__(self, "cache", cache.absolute())

    @property
    def _backend(self) -> Backend:
        local = LocalBackend(self.cache)
        if "://" not in self.url:
            return local
        # Imported late: fsspec and its protocols cost every command of a local store nothing.
        from juicer.artifacts.remote import RemoteBackend

        return RemoteBackend(self.url, local)

    def find(self, recipe: Recipe) -> ArtifactRef | None:
        """The artifact that the recipe makes, if it was made before.

        Raises:
            UnreadableArtifact: If the disk does not let that be found out.
        """
        return recipe.ref if self.exists(recipe.ref) else None

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether there is such an artifact, whole or damaged.

        Raises:
            UnreadableArtifact: If the disk does not let that be found out.
        """
        with self._explaining(ref):
            return self._backend.exists(ref)

    @contextmanager
    def create(
        self, recipe: Recipe, *, replacing: bool = False, waiting: Callable[[], None] = lambda: None
    ) -> Iterator[Draft]:
        """Make the artifact of a recipe: fill the draft inside the block, it is committed at the end of the block.

        At a failure, or a kill at any moment, the artifact is absent; what the block left in the draft's scratch
        is there for the next attempt. Whoever needs an id that is being made waits, and then gets a draft that is
        ``adopted``.

        Args:
            recipe: What the artifact is made of.
            replacing: Whether to make it even if it is there, e.g. damaged; the old one stays until the commit. If
                another process replaces it while this one waits, its work is adopted.
            waiting: Called again and again while another process makes it; ends the wait by raising.

        Raises:
            StoreNotWritable: If a write is refused, in the block or at the commit.
            UnreadableArtifact: If the disk does not let it be found out whether the artifact is there.
        """
        backend, ref = self._backend, recipe.ref
        old = self._written(ref) if replacing else None
        with explained(self.cache), backend.work.lock(ref.id, waiting):
            draft = Draft(ref, backend.work.draft(ref.id), backend.work.scratch(ref.id))
            with self._explaining(ref):
                is_made = backend.recover(ref) and (not replacing or self._written(ref) != old)
            if is_made:
                draft.adopted = True
                yield draft
            else:
                delete_tree(draft.path)
                backend.check_writable(ref)
                backend.sweep()
                with _discarded_on_failure(draft):
                    started, clock = datetime.now().astimezone(), time.monotonic()
                    yield draft
                    manifest = _describe(draft, recipe, started, time.monotonic() - clock)
                    with self._explaining(ref):
                        backend.commit(draft.path, manifest, replacing=replacing)
            discard_tree(draft.scratch)

    def open(self, ref: ArtifactRef, kind: str | None = None, *, read: Collection[str] | None = None) -> Path:
        """Folder of an artifact, after its files were found to be as they were written.

        All must be there, of their sizes, and none else but what operating systems and editors leave behind: no reader
        asks for files of such names. Contents are compared once a process; those of array chunks, which have checksums
        of their own, by whoever reads the array. :meth:`verify` compares everything.

        Args:
            ref: The artifact.
            kind: Of which kind it must be, if that matters.
            read: Paths of the only files that are going to be read; other contents are not compared then.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            WrongArtifactKind: If ``kind`` is given and is not its kind.
            DamagedArtifact: If a file is missing or altered.
            StrayFile: If a file does not belong to it.
            UnreadableArtifact: If the disk does not let it be read.
        """
        self._check_kind(ref, kind)
        with self._requiring(ref) as backend, explained(self.cache):
            return backend.open(ref, read)

    def manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of an artifact.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            DamagedArtifact: If its manifest is missing or altered.
            UnreadableArtifact: If the disk does not let it be read.
        """
        with self._requiring(ref) as backend:
            return read_manifest(backend, ref)

    def stamp(self, ref: ArtifactRef) -> str:
        """What changes whenever an artifact's manifest is written; empty if that cannot be told without reading it."""
        return self._backend.stamp(ref)

    def recipe(self, ref: ArtifactRef) -> Recipe:
        """What an artifact was made of.

        Raises:
            ArtifactError: See :meth:`manifest`.
        """
        return self.manifest(ref).recipe

    def is_there(self) -> bool:
        """Whether there is a store at all."""
        return self._backend.is_there()

    def survey(self, kind: str | None = None, beginning: str = "") -> Listing:
        """Every artifact, of one kind or of all, damaged or not, whose id begins so; and where there may be more."""
        return self._backend.survey(KINDS if kind is None else [kind], beginning)

    def refs(self, kind: str | None = None) -> Sequence[ArtifactRef]:
        """Every artifact, of one kind or of all, damaged or not; what cannot be looked at is logged."""
        listing = self.survey(kind)
        for clause in listing.unseen:
            logger.warning("there may be more artifacts: %s", clause)
        return list(listing.refs)

    def list(self, kind: str | None = None) -> Sequence[Manifest]:
        """Descriptions of every artifact, oldest first; one whose manifest cannot be had is logged and left out."""
        manifests = []
        for ref in self.refs(kind):
            try:
                manifests.append(self.manifest(ref))
            except (DamagedArtifact, UnreadableArtifact) as error:
                logger.warning("%s", error)
            except ArtifactNotFound:
                logger.debug("%s was set aside while the list was made", ref)
        return in_order(manifests)

    def resolve(self, text: str, kind: str | None = None) -> ArtifactRef:
        """The one artifact meant by an id, the beginning of an id, or ``kind/id``.

        Raises:
            ArtifactNotFound: If none or several answer to the text.
            WrongArtifactKind: If ``kind`` is given and the artifact is of another kind.
            UnreadableArtifact: If it may be where the disk does not let one look.
        """
        stated, separator, prefix = text.strip().rpartition("/")
        text = printable(text)
        if separator and stated not in KINDS:
            raise ArtifactNotFound(f"'{text}' names no kind of artifact{did_you_mean(printable(stated), KINDS)}")
        listing = self.survey(stated or None, prefix)
        matches = list(listing.refs) if prefix else []
        # A prefix may be shared by several kinds; the kind that is needed then decides.
        wanted = [ref for ref in matches if kind in (None, ref.kind)] or matches
        if listing.unseen and not (wanted and is_id(prefix)):
            raise UnreadableArtifact(
                f"it cannot be told which artifact '{text}' is: {'; '.join(listing.unseen)}; see to the permissions, "
                f"or give all {ID_LENGTH} digits of one that can be read"
            )
        if not wanted:
            raise ArtifactNotFound(f"no artifact answers to '{text}' in '{self.url}'; list them with `juicer ls`")
        if len(wanted) > 1:
            raise ArtifactNotFound(f"'{text}' is short for {', '.join(map(str, wanted))}; give more digits")
        self._check_kind(wanted[0], kind)
        return wanted[0]

    def verify(self, ref: ArtifactRef) -> Sequence[Finding]:
        """Everything that is wrong with an artifact, to the last byte; nothing if it is whole.

        Raises:
            ArtifactNotFound: If there is no such artifact.
        """
        with self._requiring(ref) as backend, explained(self.cache):
            return backend.problems(ref)

    def lineage(self, ref: ArtifactRef) -> Sequence[ArtifactRef]:
        """Every ancestor once, parents before children; one that was discarded is named but its own are not known.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            DamagedArtifact: If a manifest on the way is missing or altered.
        """

        def parents_of(each: ArtifactRef) -> Sequence[ArtifactRef]:
            return self.manifest(each).recipe.parents if each == ref or self.exists(each) else ()

        return parents_first([ref], parents_of)[:-1]

    def address(self, ref: ArtifactRef) -> str:
        """Where an artifact is, or would be, for people."""
        return self._backend.address(ref)

    def mend(self, ref: ArtifactRef) -> bool:
        """Make a damaged artifact whole from what is at hand, without making it again; gives whether that worked.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            StoreNotWritable: If the store refuses.
        """
        with self._requiring(ref) as backend, explained(self.cache), backend.work.lock(ref.id):
            return backend.mend(ref)

    def set_aside(self, ref: ArtifactRef) -> str:
        """Take an artifact out of the store, whole or damaged, unchanged; what was made from it stays.

        Returns:
            Where it is now.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            StoreNotWritable: If the store refuses.
        """
        with self._requiring(ref) as backend, explained(self.cache), backend.work.lock(ref.id):
            return backend.set_aside(ref)

    def asides(self, ref: ArtifactRef) -> Sequence[str]:
        """Where that is which was set aside of an artifact, oldest first."""
        return self._backend.asides(ref)

    def _written(self, ref: ArtifactRef) -> bytes | None:
        """What tells an artifact from its successor, which has the same id."""
        try:
            return self._backend.read(ref)
        except TroubleError:
            return None

    @contextmanager
    def _requiring(self, ref: ArtifactRef) -> Iterator[Backend]:
        """Work on an artifact that must exist; what is wrong with it becomes an error that says how to mend it."""
        if not self.exists(ref):
            raise ArtifactNotFound(f"artifact {ref} does not exist in '{self.url}'; see `juicer ls {ref.kind}`")
        with self._explaining(ref):
            yield self._backend

    @contextmanager
    def _explaining(self, ref: ArtifactRef) -> Iterator[None]:
        try:
            yield
        except TroubleError as trouble:
            raise self._error(ref, trouble.finding) from None

    def _error(self, ref: ArtifactRef, finding: Finding) -> ArtifactError:
        clause, remedy = finding.clause, finding.remedy
        if finding.nature is Nature.DAMAGE:
            remedy = remedy or f"recompute it with `juicer repair {ref.id}`"
            return DamagedArtifact(f"artifact {ref} is damaged: {clause}; {remedy}")
        if finding.nature is Nature.UNREADABLE:
            remedy = remedy or f"see to its permissions and to the disk in '{self.cache}'"
            return UnreadableArtifact(f"artifact {ref} may be whole, but {clause}; {remedy}")
        return StrayFile(f"artifact {ref} is whole, but {clause}; remove that from '{self.address(ref)}'")

    @staticmethod
    def _check_kind(ref: ArtifactRef, kind: str | None) -> None:
        if kind not in (None, ref.kind):
            raise WrongArtifactKind(
                f"{ref} is of kind '{ref.kind}' but '{kind}' is needed here; see `juicer ls {kind}`"
            )


def in_order(manifests: Iterable[Manifest]) -> list[Manifest]:
    """Descriptions sorted by age, the oldest first."""
    return sorted(manifests, key=lambda manifest: (datetime.fromisoformat(manifest.finished), manifest.ref))


@contextmanager
def _discarded_on_failure(draft: Draft) -> Iterator[None]:
    """Make the folders of a draft; at a failure its files go, and what it left in its scratch stays."""
    draft.path.mkdir(parents=True)
    draft.scratch.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        discard_tree(draft.path)
        with suppress(OSError):
            # Succeeds only if it is empty.
            draft.scratch.rmdir()
        raise


def _describe(draft: Draft, recipe: Recipe, started: datetime, seconds: float) -> Manifest:
    files = describe_files(draft.path)
    measured = {} if draft.cpu_seconds is None else {CPU_SECONDS: round(draft.cpu_seconds, 3)}
    finished = datetime.now().astimezone()
    return Manifest(
        recipe=recipe,
        files=files,
        summary=plain(draft.summary),
        host={**describe_host(), **measured},
        started=started.isoformat(timespec="milliseconds"),
        finished=finished.isoformat(timespec="milliseconds"),
        seconds=round(seconds, 3),
    )
