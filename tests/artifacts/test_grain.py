"""The grain of identity: which stages of which tasks run again after a change, by their real recipes.

The table below is printed for people by ``python -m pytest tests/artifacts/test_grain.py -s -k printed``.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from juicer.annotation.propose import AnnotationConfig
from juicer.artifacts import code_version
from juicer.artifacts.junctions import JUNCTIONS
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.source_tree import Source, SourceTree
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.pretrained.config import Weights
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.comparison import ReportRow
from juicer.tasks import content
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.tasks.specification import AssemblyTask
from juicer.training.mixing import DatasetConfig
from juicer.views import View
from stages.annotate import annotate
from stages.augment import AugmentConfig, augment
from stages.collect import CollectConfig, collect
from stages.correct import CorrectConfig, correct
from stages.dataset import dataset
from stages.encode import EncodeConfig, encode
from stages.estimate import EstimateConfig, estimate
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.modes import ModesConfig, modes
from stages.monitor import MonitorConfig, monitor
from stages.record import RecordConfig, record
from stages.render import RenderConfig, render
from stages.report import ReportConfig, report
from stages.runtime.names import STAGES
from stages.runtime.session import Session
from stages.sampling import SamplingConfig, sampling
from stages.select import SelectConfig, select
from stages.train import TrainConfig, train

ROOT = Path(__file__).parents[2]
PACKAGES = ("juicer", "stages", "flows")

ANALYSES = {"sampling", "monitor", "modes"}
FROM_EVALUATION = {"evaluate", "modes", "report"}
FROM_SELECTION = {"select", "mix", "retrain", *ANALYSES, *FROM_EVALUATION}
FROM_TRAINING = {"train", "collect", "correct", *FROM_SELECTION}
FROM_AUGMENTATION = {"augment", "dataset", *FROM_TRAINING}
ON_ESTIMATES = {"train on estimates", "evaluate estimates"}
ESTIMATING = {"encode estimates", *ON_ESTIMATES}
FROM_ANNOTATION = {"annotate", "estimate", *ESTIMATING, *FROM_AUGMENTATION}
LOOKING = {"look and train", "look and evaluate"}
FROM_DRAWING = {"render", "encode", "images", "estimate", *ESTIMATING, *LOOKING}
EVALUATIONS = {"look and evaluate", "evaluate estimates"}
FROM_INGESTION = {"ingest", "memorise", *FROM_DRAWING, *FROM_ANNOTATION}
EVERYTHING = {"record", *FROM_INGESTION}
NOTHING: set[str] = set()

Edit = Callable[[str], str]


def append(line: str) -> Edit:
    return lambda source: f"{source}\n{line}\n"


def rewrite(old: str, new: str) -> Edit:
    def edit(source: str) -> str:
        assert old in source
        return source.replace(old, new, 1)

    return edit


def recolour(task: AssemblyTask) -> AssemblyTask:
    return _with_part(task, 0, rgb=(0.1, 0.2, 0.3))


def thicken_thread(task: AssemblyTask) -> AssemblyTask:
    (thread,) = task.parts[1].threads
    return _with_part(task, 1, threads=(replace(thread, bead_radius=thread.bead_radius + 1e-4),))


def grasp_higher(task: AssemblyTask) -> AssemblyTask:
    handling = task.parts[1].handling
    return _with_part(task, 1, handling=replace(handling, pick_m=handling.pick_m + 1e-3))


def _with_part(task: AssemblyTask, index: int, **changes: object) -> AssemblyTask:
    parts = [replace(part, **changes) if place == index else part for place, part in enumerate(task.parts)]
    return replace(task, parts=tuple(parts))


def fewer_critical_states(task: AssemblyTask) -> AssemblyTask:
    return replace(task, critical_states=task.critical_states[1:])


@dataclass(frozen=True)
class Change:
    """A change of the house, and what runs again because of it.

    Attributes:
        name: What it is.
        again: What runs again, for the tasks it concerns.
        edits: What happens to the text of a file, new ones included.
        data: What happens to the data of a task.
        tasks: Which tasks it concerns.
    """

    name: str
    again: set[str]
    edits: tuple[tuple[str, Edit], ...] = ()
    data: Callable[[AssemblyTask], AssemblyTask] | None = None
    tasks: tuple[str, ...] = TASK_NAMES


def edit(name: str, path: str, change: Edit, again: set[str]) -> Change:
    return Change(name, again, ((path, change),))


def data(name: str, task: str, change: Callable[[AssemblyTask], AssemblyTask], again: set[str]) -> Change:
    return Change(name, again, data=change, tasks=(task,))


def member(name: str, folder: str, again: set[str]) -> Change:
    files = (("__init__.py", '"""New."""'), ("config.py", "SIZE = 1"), ("network.py", "from .config import SIZE"))
    return Change(name, again, tuple((f"{folder}/{file}", append(text)) for file, text in files))


CODE = append("CHANGED = True")
FIFTH = "from juicer.tasks.one_leg import TASK as OTHER\n\nTASK = OTHER\n"
COLUMN = rewrite('"confidence": pa.float64(),', '"confidence": pa.float64(),\n        "minutes": pa.float64(),')
MEMBERS = tuple(
    edit(name, f"juicer/policy/{path}", CODE, again)
    for name, path, again in (
        ("the encoder of states", "encoders/features/config.py", {"estimate"} | FROM_TRAINING | ESTIMATING),
        ("the encoder that estimates", "encoders/estimated/network.py", {"estimate", *ESTIMATING}),
        ("the encoder of images", "encoders/images/network.py", {"encode", *LOOKING}),
        ("the backbone", "backbones/patch_cnn/network.py", {"encode", "estimate", *LOOKING, *ESTIMATING}),
        ("the head that the policies use", "heads/diffusion/network.py", FROM_TRAINING | LOOKING | ON_ESTIMATES),
        ("a head that they do not use", "heads/mlp/network.py", NOTHING),
        ("a denoiser that they do not use", "denoisers/mlp/network.py", NOTHING),
    )
    if (ROOT / "juicer" / "policy" / path).exists()
)
CHANGES = (
    member("a new encoder", "juicer/policy/encoders/resnet", NOTHING),
    member("a new backbone", "juicer/policy/backbones/mobilenet", NOTHING),
    member("a new head", "juicer/policy/heads/flow_matching", NOTHING),
    *MEMBERS,
    edit("a fifth task", "juicer/tasks/stool.py", append(FIFTH), NOTHING),
    data("a colour of round_table", "round_table", recolour, {"report", *FROM_DRAWING}),
    data("a thread radius of lamp", "lamp", thicken_thread, EVERYTHING),
    data("the operator's grasp of lamp's bulb", "lamp", grasp_higher, EVERYTHING),
    data("the critical states of lamp", "lamp", fewer_critical_states, FROM_ANNOTATION),
    edit("lamp written down in other words", "juicer/tasks/lamp.py", CODE, NOTHING),
    edit("the operator's habits", "juicer/expert/habits.py", CODE, EVERYTHING),
    edit("the renderer", "juicer/imaging/renderer.py", CODE, {"report", *FROM_DRAWING}),
    edit("how videos are written", "juicer/imaging/video.py", CODE, {"report"}),
    edit("a sentence in the report", "juicer/reporting/page.py", CODE, {"report"}),
    edit("an MLflow tag", "stages/tracking/record.py", CODE, NOTHING),
    edit("the store", "juicer/artifacts/store.py", CODE, NOTHING),
    edit("a message in errors", "juicer/errors.py", CODE, NOTHING),
    edit("the progress display", "flows/terminal/progress.py", CODE, NOTHING),
    edit("how tasks are found", "juicer/tasks/discovery.py", CODE, NOTHING),
    edit("geometry", "juicer/geometry.py", CODE, EVERYTHING),
    edit("the controller", "juicer/sim/controller.py", CODE, EVERYTHING),
    edit("a rule that proposes critical states", "juicer/annotation/propose.py", CODE, FROM_ANNOTATION),
    edit("a column of the annotations table", "juicer/storage/annotations.py", COLUMN, FROM_ANNOTATION),
    edit("the augmentation's return path", "juicer/augmentation/plan.py", CODE, FROM_AUGMENTATION),
    edit("the normaliser", "juicer/policy/normalizer.py", CODE, {"estimate"} | FROM_TRAINING | LOOKING | ESTIMATING),
    edit(
        "how pretrained weights are read",
        "juicer/policy/pretrained/loading.py",
        CODE,
        {"encode", "estimate"} | FROM_TRAINING | LOOKING | ESTIMATING,
    ),
    edit("a file of weights that somebody publishes", "juicer/policy/pretrained/known.py", CODE, NOTHING),
    edit("the optimiser's loop", "juicer/training/trainer.py", CODE, FROM_TRAINING | LOOKING | ON_ESTIMATES),
    edit("how states are displaced", "juicer/estimation/perturbation.py", CODE, {"estimate", *ESTIMATING}),
    edit("how an estimator learns", "juicer/estimation/learning.py", CODE, {"estimate", *ESTIMATING}),
    edit("rollouts", "juicer/rollout.py", CODE, {"collect", "correct", *EVALUATIONS, *FROM_SELECTION}),
    edit("the rule of selection", "stages/select.py", CODE, FROM_SELECTION),
    edit(
        "a confidence interval",
        "juicer/evaluation.py",
        CODE,
        {*EVALUATIONS, *FROM_EVALUATION},
    ),
    edit("how a failure monitor is judged", "juicer/analysis/monitoring.py", CODE, {"monitor", "report"}),
)

EYES = ImagesConfig(views={"wrist": View(camera="wrist")})
FILED = EYES.backbone.model_copy(update={"weights": Weights(file="any.pth", sha256="0" * 64, licence="MIT")})
FROZEN = EYES.model_copy(update={"backbone": FILED, "frozen": True})
LOOKING_POLICY = PolicyConfig(observation={"eyes": EYES})
"""Head and limits as the others have them."""

Recipes = dict[str, dict[str, Recipe]]
"""By task and call."""


class House:
    """A copy of the source that can be changed, and the recipes of the whole loop that follow from it."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder = folder
        self._patch = monkeypatch
        self._read: dict[Path, Source] = {}
        self._found: dict[str, dict[str, set[str]]] = {}
        for package in PACKAGES:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / package, folder / package, ignore=ignored)
        self.before = self._recipes()

    def again(self, change: Change) -> dict[str, set[str]]:
        """What runs again after a change, by task; the change is taken back, and none is made twice."""
        if change.name not in self._found:
            self._found[change.name] = self._after(change)
        return self._found[change.name]

    def _after(self, change: Change) -> dict[str, set[str]]:
        olds = {}
        for name, edit in change.edits:
            path = self._folder / name
            olds[path] = path.read_text() if path.exists() else None
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(edit(olds[path] or ""))
        after = self._recipes(change, olds)
        for path, old in olds.items():
            path.unlink() if old is None else path.write_text(old)
        return {
            task: {name for name, recipe in recipes.items() if recipe.id != self.before[task][name].id}
            for task, recipes in after.items()
        }

    def _recipes(self, change: Change | None = None, changed: dict[Path, str | None] | None = None) -> Recipes:
        # What is not changed is read once.
        sources = {path: source for path, source in self._read.items() if path not in (changed or {})}
        folders = {name: self._folder / name for name in ("juicer", "stages")}
        tree = SourceTree(folders, code_version.PLUMBING, JUNCTIONS, sources)

        def task_of(name: str) -> AssemblyTask:
            task = get_task(name)
            return change.data(task) if change and change.data and name in change.tasks else task

        with self._patch.context() as patch:
            patch.setattr(code_version, "_source_tree", lambda packages: tree)
            patch.setattr(content, "get_task", task_of)
            recipes = {task: loop(task) for task in TASK_NAMES}
        if change is None:
            self._read = sources
        return recipes


def loop(task: str) -> dict[str, Recipe]:
    """Recipes of every call of the loop for one task, made in thought."""
    session = Session(ArtifactStore("/nowhere"), lambda call, session: call.recipe.ref)
    start = {"task": task, "randomness": "low"}
    made = {"record": record(session, config=RecordConfig(**start))}
    demonstrations = made["ingest"] = ingest(session, logs=made["record"], config=IngestionConfig(task=task))
    made["memorise"] = memorise(session, episodes=demonstrations, config=MemoriseConfig())
    made["render"] = render(session, episodes=demonstrations, config=RenderConfig(view=View(camera="wrist")))
    made["images"] = dataset(session, episodes=(demonstrations,), columns=(made["render"],), config=DatasetConfig())
    made["encode"] = encode(session, episodes=demonstrations, config=EncodeConfig(encoder=FROZEN.fixed_parts[0]))
    made["look and train"] = train(session, dataset=made["images"], config=TrainConfig(policy=LOOKING_POLICY))
    made["look and evaluate"] = evaluate(session, checkpoint=made["look and train"], config=EvaluateConfig(**start))
    made["annotate"] = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    made |= estimating(session, demonstrations, made["annotate"], start)
    made["augment"] = augment(session, episodes=demonstrations, annotations=made["annotate"], config=AugmentConfig())
    episodes = (demonstrations, made["augment"])
    made["dataset"] = dataset(session, episodes=episodes, config=DatasetConfig())
    made["train"] = train(session, dataset=made["dataset"], config=TrainConfig())
    made["collect"] = collect(session, checkpoint=made["train"], config=CollectConfig(**start))
    made["correct"] = correct(session, episodes=made["collect"], config=CorrectConfig())
    made["select"] = select(session, episodes=made["collect"], config=SelectConfig())
    made["mix"] = dataset(
        session, episodes=(*episodes, made["collect"]), selections=(made["select"],), config=DatasetConfig()
    )
    made["retrain"] = train(session, dataset=made["mix"], config=TrainConfig(seed=1))
    made["evaluate"] = evaluate(session, checkpoint=made["retrain"], config=EvaluateConfig(**start))
    made["sampling"] = sampling(
        session,
        checkpoint=made["retrain"],
        episodes=demonstrations,
        annotations=made["annotate"],
        config=SamplingConfig(task=task),
    )
    made["monitor"] = monitor(session, checkpoint=made["retrain"], config=MonitorConfig(**start))
    made["modes"] = modes(
        session, checkpoint=made["retrain"], evaluations=(made["evaluate"],), config=ModesConfig(task=task)
    )
    rows = (ReportRow(condition="ta_ci", title="TA+CI", seed=0),)
    shown = tuple(AnalysisRow(name=name, condition="ta_ci", title="TA+CI", seed=0) for name in sorted(ANALYSES))
    made["report"] = report(
        session,
        evaluations=(made["evaluate"],),
        analyses=tuple(made[name] for name in sorted(ANALYSES)),
        config=ReportConfig(title="All", task=task, rows=rows, analyses=shown),
    )
    return {name: session.recipe(ref) for name, ref in made.items()}


def estimating(
    session: Session, demonstrations: ArtifactRef, annotations: ArtifactRef, start: dict[str, str]
) -> dict[str, ArtifactRef]:
    """Calls for a policy that estimates poses."""
    estimated, made = EstimatedConfig(), {}
    made["estimate"] = estimate(
        session, episodes=demonstrations, annotations=annotations, config=EstimateConfig(encoder=estimated)
    )
    read = {"estimators": (made["estimate"],), "config": EncodeConfig(encoder=estimated)}
    made["encode estimates"] = encode(session, episodes=demonstrations, **read)
    made["train on estimates"] = train(
        session,
        dataset=dataset(
            session, episodes=(demonstrations,), columns=(made["encode estimates"],), config=DatasetConfig()
        ),
        estimators=(made["estimate"],),
        config=TrainConfig(policy=PolicyConfig(observation={"state": estimated})),
    )
    made["evaluate estimates"] = evaluate(
        session, checkpoint=made["train on estimates"], config=EvaluateConfig(**start)
    )
    return made


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    with pytest.MonkeyPatch.context() as patch:
        yield House(tmp_path_factory.mktemp("house"), patch)


def test_the_loop_has_every_stage(house: House) -> None:
    assert {recipe.stage for recipe in house.before["lamp"].values()} == set(STAGES)


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_exactly_what_a_change_concerns_runs_again(house: House, change: Change) -> None:
    expected = {task: change.again if task in change.tasks else NOTHING for task in TASK_NAMES}
    assert house.again(change) == expected


def test_what_shows_results_counts_for_the_report_alone_and_what_draws_for_those_that_look(house: House) -> None:
    for recipes in house.before.values():
        for name, recipe in recipes.items():
            shows = any(
                module.startswith(("juicer.reporting", "stages.tracking", "flows")) for module in recipe.modules
            )
            draws = any(module.startswith("juicer.imaging") for module in recipe.modules)
            assert shows == (name == "report"), name
            assert draws == (name in {"report", "render", "encode", "estimate", *ESTIMATING, *LOOKING}), name


def test_a_call_names_its_own_task_and_no_other(house: House) -> None:
    for task, recipes in house.before.items():
        assert all(list(recipe.tasks) == [task] for recipe in recipes.values())
        assert recipes["select"].tasks[task] == {}
        assert not {"rgb", "marks"} & set(recipes["record"].tasks[task]["parts"][0])
        for name in ("report", "render", "look and evaluate"):
            assert {"rgb", "marks"} <= set(recipes[name].tasks[task]["parts"][0])


def test_the_table_can_be_printed(house: House) -> None:
    """As Markdown, for docs/architecture.md."""
    columns = list(house.before["lamp"])
    lines = [f"| a change of … | tasks | {' | '.join(columns)} |", f"|{' --- |' * (len(columns) + 2)}"]
    for change in CHANGES:
        again = house.again(change)
        concerned = [task for task in TASK_NAMES if again[task]]
        tasks = "all" if len(concerned) == len(TASK_NAMES) else ", ".join(concerned) or "none"
        run = again[concerned[0]] if concerned else NOTHING
        lines.append(f"| {change.name} | {tasks} | {' | '.join('●' if name in run else '' for name in columns)} |")
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
    assert len(lines) - 2 == len(CHANGES) >= 15
