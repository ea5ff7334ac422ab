"""The ``juicer`` command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import errno
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from flows.command.arguments import (
    AnalysisOverrides,
    ArtifactId,
    AsJson,
    CheckpointId,
    Conditions,
    ConfigFile,
    Configuration,
    EpisodeName,
    Episodes,
    ImportAs,
    LabelsFile,
    Numbered,
    Overrides,
    Seeds,
    ShiftKind,
    StageName,
    TaskOfCheckpoint,
    Tasks,
)
from flows.command.options import CommandLine, choice
from flows.command.serving import app as serving
from flows.servers.proxies import bypass_proxies_on_loopback
from flows.terminal.output import say_error
from flows.terminal.streams import tolerate_refusals
from juicer import __version__
from juicer.artifacts.ref import KINDS
from juicer.errors import ConfigError, JuicerError
from juicer.tasks.specification import Randomness

VIEWS = ("front", "wrist", "both")
ANALYSES = ("sampling", "modes", "monitor")
FAILED = 1
INTERRUPTED = 130

app = CommandLine(
    help="Robot assembly policies from a few dozen demonstrations: augment, imitate, collect, retrain, evaluate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _say_version(asked: bool) -> None:
    if asked:
        typer.echo(f"juicer {__version__}")
        raise typer.Exit


@app.callback()
def _whole(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    config: Configuration,
    overrides: Overrides = None,
    task: Tasks = None,
    condition: Conditions = None,
    seed: Seeds = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only tell what would be reused or computed.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run the whole loop: one model, or a study of several conditions and seeds."""
    from flows.command.choice import Choice
    from flows.command.run import preview_flow, run_flow

    (preview_flow if dry_run else run_flow)(Choice.of(config, overrides, task, condition, seed), as_json)


@app.command("config")
def show_config(
    config: Configuration,
    overrides: Overrides = None,
    task: Tasks = None,
    condition: Conditions = None,
    seed: Seeds = None,
    as_json: AsJson = False,
) -> None:
    """Print a configuration in full, and where each of its values comes from; the output is a configuration itself."""
    from flows.command.choice import Choice
    from flows.command.config import print_configuration

    print_configuration(Choice.of(config, overrides, task, condition, seed), as_json)


@app.command()
def stage(
    name: StageName,
    config: ConfigFile,
    overrides: Overrides = None,
    task: Tasks = None,
    condition: Conditions = None,
    seed: Seeds = None,
    force: Annotated[bool, typer.Option("--force", help="Recompute even if the artifact is in the store.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run one stage of a configuration from inputs that are in the store."""
    from flows.command.choice import Choice
    from flows.command.run import run_stage

    run_stage(name, Choice.of(config, overrides, task, condition, seed), force, as_json)


@app.command()
def explain(
    name: StageName,
    config: ConfigFile,
    overrides: Overrides = None,
    task: Tasks = None,
    condition: Conditions = None,
    seed: Seeds = None,
    as_json: AsJson = False,
) -> None:
    """Say why a stage would be reused or computed."""
    from flows.command.choice import Choice
    from flows.command.run import explain_stage

    explain_stage(name, Choice.of(config, overrides, task, condition, seed), as_json)


@app.command()
def report(
    config: Configuration,
    overrides: Overrides = None,
    task: Tasks = None,
    condition: Conditions = None,
    seed: Seeds = None,
    beside: Annotated[
        list[str] | None,
        typer.Option(
            "--with", metavar="CONFIG", help="Another configuration for the same page, as it stands; repeat it."
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="Page to write: .html, or .md with drawings beside it."),
    ] = Path("study.md"),
    as_json: AsJson = False,
) -> None:
    """Write what is known of a study so far, all its tasks together, as a page."""
    from flows.command.choice import Choice
    from flows.command.report import write_report_page

    chosen = [Choice.of(config, overrides, task, condition, seed), *map(Choice, beside or ())]
    write_report_page(chosen, output, as_json)


@app.command("ls")
def list_artifacts(
    kind: Annotated[
        str | None,
        typer.Argument(help=f"Kind of artifact: {', '.join(KINDS)}; all if left out.", **choice(KINDS, "[KIND]")),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the artifacts in the store."""
    from flows.command.show import list_kind

    list_kind(kind, as_json)


@app.command()
def show(artifact: ArtifactId, as_json: AsJson = False) -> None:
    """Describe an artifact: what made it, of what, and what it holds."""
    from flows.command.show import show_artifact

    show_artifact(artifact, as_json)


@app.command()
def lineage(artifact: ArtifactId, as_json: AsJson = False) -> None:
    """Draw what an artifact was made from."""
    from flows.command.show import show_lineage

    show_lineage(artifact, as_json)


@app.command()
def labels(artifact: ArtifactId, file: LabelsFile, numbered: Numbered = None, import_as: ImportAs = None) -> None:
    """Write critical states as a labels file, to correct them by hand; or take such a file into what people said."""
    from flows.command.labels import import_labels_file, write_labels_file

    if import_as is not None and numbered is not None:
        raise ConfigError("--numbered tells what a labels file is written from; it does not go with --import-as")
    if import_as is None:
        write_labels_file(artifact, file, numbered)
    else:
        import_labels_file(artifact, file, import_as)


@app.command()
def verify(
    artifact: Annotated[str | None, typer.Argument(metavar="[ID]", help="Artifact; all if left out.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check that artifacts are as they were written."""
    from flows.command.show import verify_artifacts

    verify_artifacts(artifact, as_json)


@app.command()
def repair(
    artifact: ArtifactId,
    files: Annotated[
        Path | None, typer.Option("--files", help="Folder of the logs or labels that a human gave.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Recompute a damaged artifact from what it was made from."""
    from flows.command.evaluate import repair_artifact

    repair_artifact(artifact, files, as_json)


@app.command()
def evaluate(
    checkpoint: CheckpointId,
    episodes: Annotated[int, typer.Option("--episodes", "-n", min=1, help="Evaluation episodes.")] = 100,
    seed_start: Annotated[
        int, typer.Option("--seed-start", min=0, help="Position of the first initial state among those for evaluation.")
    ] = 0,
    randomness: Annotated[
        str, typer.Option("--randomness", help="Level of the initial states.", **choice(Randomness))
    ] = Randomness.LOW.value,
    task: TaskOfCheckpoint = None,
    inference_steps: Annotated[
        int | None,
        typer.Option("--inference-steps", min=1, help="Steps that sample an action chunk, if not the policy's own."),
    ] = None,
    until_width: Annotated[
        float | None,
        typer.Option(
            "--until-width",
            metavar="WIDTH",
            help="End as soon as the 95 % interval is at most so wide, e.g. 0.2; looked at after every 25 episodes.",
        ),
    ] = None,
    samples: Annotated[
        int,
        typer.Option("--samples", min=1, help="Chunks drawn at each prediction; the one where they are densest acts."),
    ] = 1,
    shift: ShiftKind = None,
    as_json: AsJson = False,
) -> None:
    """Measure the success rate of a checkpoint."""
    from flows.command.evaluate import evaluate_checkpoint

    asked = {
        "task": task,
        "episodes": episodes,
        "first": seed_start,
        "randomness": randomness,
        "inference_steps": inference_steps,
        "samples": samples,
        "shift": shift,
    }
    evaluate_checkpoint(checkpoint, asked, until_width, as_json)


@app.command()
def analyse(
    kind: Annotated[
        str, typer.Argument(help=f"What is to be known: {', '.join(ANALYSES)}.", **choice(ANALYSES, "KIND"))
    ],
    checkpoint: CheckpointId,
    task: TaskOfCheckpoint = None,
    overrides: AnalysisOverrides = None,
    figure: Annotated[Path | None, typer.Option("--figure", help="File to write the figure to, as PNG.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find out more about a checkpoint than its success rate, e.g. juicer analyse monitor ID --set randomness=med."""
    from flows.command.analyse import analyse_checkpoint

    analyse_checkpoint(kind, checkpoint, task, overrides or (), figure, as_json)


@app.command()
def replay(
    episodes: Episodes,
    episode: EpisodeName = "0",
    video: Annotated[
        Path | None,
        typer.Option("--video", help="Video to write, EPISODES-EPISODE.mp4 if left out; stills go beside it as PNG."),
    ] = None,
    camera: Annotated[
        str,
        typer.Option("--camera", help="Where it is seen from; both are side by side.", **choice(VIEWS)),
    ] = "both",
    size: Annotated[
        str, typer.Option("--size", metavar="WIDTHxHEIGHT", help="Size of each camera's image in pixels.")
    ] = "480x360",
    speed: Annotated[float, typer.Option("--speed", min=0.1, max=100, help="Times faster than real time.")] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Make a video of any episode in the store, with step numbers and milestones."""
    from flows.command.replay import replay_episode

    replay_episode(episodes, episode, video, camera, size, speed, as_json)


@app.command()
def view(
    episodes: Episodes,
    episode: EpisodeName = "0",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Recording to write, EPISODES-EPISODE.rrd if left out."),
    ] = None,
    opens: Annotated[bool, typer.Option("--open/--no-open", help="Open the viewer, or only write the file.")] = True,
    as_json: AsJson = False,
) -> None:
    """Look at any episode in the store in Rerun: images, poses and numbers over its steps."""
    from flows.command.view import view_episode

    view_episode(episodes, episode, output, opens, as_json)


@app.command()
def doctor(
    encoders: Annotated[
        bool, typer.Option("--encoders", help="List encoders instead: their weights, where they are or come from.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Examine this machine, and say what to do where something stands in juicer's way."""
    from flows.command.doctor import examine_machine, show_encoders

    (show_encoders if encoders else examine_machine)(as_json)


app.add_typer(serving)


def main() -> None:
    """Entry point: 0 on success, 1 after an error, 2 after a wrong call, 130 after Ctrl-C."""
    # A shell that starts a command in the background has it ignore the interrupt; a service manager sends the other.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    output = tolerate_refusals()
    status = call(sys.argv[1:])
    sys.stdout.flush()
    # A reader that has seen enough, as `head` has, is no failure.
    if output.refusal is not None and output.refusal.errno != errno.EPIPE:
        say_error(f"standard output takes no more ({output.refusal.strerror}); the command is done", "Output", False)
        status = status or 1
    sys.exit(status)


def call(arguments: list[str]) -> int:
    """Run a command; gives its exit status."""
    bypass_proxies_on_loopback()
    command = typer.main.get_command(app)
    as_json = "--json" in arguments
    try:
        status = command.main(arguments, prog_name="juicer", standalone_mode=False)
    except typer.TyperException as error:
        say_error(error.format_message(), "UsageError", as_json)
        return error.exit_code
    except JuicerError as error:
        say_error(str(error), type(error).__name__, as_json)
        return FAILED
    # Typer turns Ctrl-C into this status.
    if status == INTERRUPTED:
        say_error("interrupted; nothing is half-written, the same command continues the work", "Interrupted", as_json)
    return status if isinstance(status, int) else 0


if __name__ == "__main__":
    main()
