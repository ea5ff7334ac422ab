"""The artifact store: find, create, open, and follow where artifacts come from."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from juicer.artifacts.backend import Backend
from juicer.artifacts.draft import Draft
from juicer.artifacts.integrity import DamageError, UnreadableError, describe_files
from juicer.artifacts.local import LocalBackend
from juicer.artifacts.manifest import Manifest, describe_host, plain
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import KINDS, ArtifactRef
from juicer.artifacts.workspace import delete_tree, discard_tree
from juicer.artifacts.writing import explained
from juicer.errors import (
    ArtifactNotFound,
    DamagedArtifact,
    UnreadableArtifact,
    WrongArtifactKind,
    did_you_mean,
)

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
        """The artifact that the recipe makes, if it was made before."""
        return recipe.ref if self._backend.exists(recipe.ref) else None

    @contextmanager
    def create(self, recipe: Recipe, *, replacing: bool = False) -> Iterator[Draft]:
        """Make the artifact of a recipe: fill the draft inside the block, it is committed at the end of the block.

        At a failure, or a kill at any moment, the artifact is absent; what the block left in the draft's scratch
        is there for the next attempt. Whoever needs an id that is being made waits, and then gets a draft that is
        ``adopted``.

        Args:
            recipe: What the artifact is made of.
            replacing: Whether to make it even if it is there, e.g. damaged; the old one stays until the commit.

        Raises:
            StoreNotWritable: If a write is refused, in the block or at the commit.
        """
        backend, ref = self._backend, recipe.ref
        with explained(self.cache), backend.work.lock(ref.id):
            draft = Draft(ref, backend.work.draft(ref.id), backend.work.scratch(ref.id))
            if not replacing and backend.recover(ref):
                draft.adopted = True
                yield draft
            else:
                backend.check_writable()
                delete_tree(draft.path)
                backend.work.sweep({done.id for done in LocalBackend(self.cache).refs(KINDS)})
                with _discarded_on_failure(draft):
                    started = datetime.now().astimezone()
                    yield draft
                    backend.commit(draft.path, _describe(draft, recipe, started), replacing=replacing)
            discard_tree(draft.scratch)

    def open(self, ref: ArtifactRef, kind: str | None = None) -> Path:
        """Folder of an artifact, after every file was found to be as it was written.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            WrongArtifactKind: If ``kind`` is given and is not its kind.
            DamagedArtifact: If a file is missing, altered or does not belong to it.
        """
        self._check_kind(ref, kind)
        with self._requiring(ref) as backend, explained(self.cache):
            return backend.open(ref)

    def manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of an artifact.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            DamagedArtifact: If its manifest is missing or altered.
            UnreadableArtifact: If the disk does not let it be read.
        """
        with self._requiring(ref) as backend:
            return backend.read_manifest(ref)

    def refs(self, kind: str | None = None) -> Sequence[ArtifactRef]:
        """Every artifact, of one kind or of all, damaged or not."""
        return self._backend.refs(KINDS if kind is None else [kind])

    def list(self, kind: str | None = None) -> Sequence[Manifest]:
        """Descriptions of every artifact, oldest first; one whose manifest cannot be had is logged and left out."""
        manifests = []
        for ref in self.refs(kind):
            try:
                manifests.append(self.manifest(ref))
            except (DamagedArtifact, UnreadableArtifact) as error:
                logger.warning("%s", error)
            except ArtifactNotFound:
                logger.debug("%s was discarded while the list was made", ref)
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
        with self._requiring(ref) as backend, explained(self.cache):
            return backend.problems(ref)

    def lineage(self, ref: ArtifactRef) -> Sequence[ArtifactRef]:
        """Every ancestor once, parents before children; one that was discarded is named but its own are not known.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            DamagedArtifact: If a manifest on the way is missing or altered.
        """
        order: dict[ArtifactRef, None] = {}

        def visit(child: ArtifactRef) -> None:
            for parent in self.manifest(child).recipe.parents:
                if parent not in order:
                    if self._backend.exists(parent):
                        visit(parent)
                    order[parent] = None

        visit(ref)
        return list(order)

    def discard(self, ref: ArtifactRef) -> None:
        """Delete an artifact, whole or damaged; what was made from it stays.

        Raises:
            ArtifactNotFound: If there is no such artifact.
            StoreNotWritable: If the store refuses.
        """
        with self._requiring(ref) as backend, explained(self.cache), backend.work.lock(ref.id):
            backend.remove(ref)

    @contextmanager
    def _requiring(self, ref: ArtifactRef) -> Iterator[Backend]:
        """Work on an artifact that must exist; damage found meanwhile becomes an error that says how to mend it."""
        backend = self._backend
        if not backend.exists(ref):
            raise ArtifactNotFound(f"artifact {ref} does not exist in '{self.url}'; see `juicer ls {ref.kind}`")
        try:
            yield backend
        except UnreadableError as refusal:
            raise UnreadableArtifact(
                f"artifact {ref} may be whole, but {refusal}; see to its permissions and to the disk in '{self.cache}'"
            ) from None
        except DamageError as damage:
            raise DamagedArtifact(
                f"artifact {ref} is damaged: {damage}; recompute it with `juicer repair {ref.id}`"
            ) from None

    @staticmethod
    def _check_kind(ref: ArtifactRef, kind: str | None) -> None:
        if kind not in (None, ref.kind):
            raise WrongArtifactKind(
                f"{ref} is of kind '{ref.kind}' but '{kind}' is needed here; see `juicer ls {kind}`"
            )


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


def _describe(draft: Draft, recipe: Recipe, started: datetime) -> Manifest:
    files = describe_files(draft.path)
    finished = datetime.now().astimezone()
    return Manifest(
        recipe=recipe,
        files=files,
        summary=plain(draft.summary),
        host=describe_host(),
        started=started.isoformat(timespec="milliseconds"),
        finished=finished.isoformat(timespec="milliseconds"),
        seconds=round((finished - started).total_seconds(), 3),
    )
