"""The ``juicer`` command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from juicer.errors import JuicerError
from juicer.sim.display import draw_without_display

INTERRUPTED = 130

app = typer.Typer(
    help="Robot assembly policies from a few dozen demonstrations: augment, imitate, collect, retrain, evaluate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ConfigFile = Annotated[Path, typer.Option("--config", "-c", help="Configuration file of the run.")]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", "-s", metavar="KEY=VALUE", help="Change a value of the configuration.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
OneCondition = Annotated[str | None, typer.Option("--condition", help="Only this condition of a study.")]
OneSeed = Annotated[int | None, typer.Option("--seed", help="Only this seed of a study.")]
OneTask = Annotated[str | None, typer.Option("--task", help="Only this of the configuration's tasks.")]
ArtifactId = Annotated[str, typer.Argument(metavar="ID", help="Id of an artifact, or its first letters.")]


@app.command()
def run(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="Configuration file.")],
    overrides: Overrides = None,
    task: OneTask = None,
    condition: OneCondition = None,
    seed: OneSeed = None,
    as_json: AsJson = False,
) -> None:
    """Run the whole loop: one model, or a study of several conditions and seeds."""
    from flows.commands.running import Part, run_flow

    run_flow(config, overrides or [], Part(task, condition, seed), as_json)


@app.command()
def stage(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Stage, e.g. train.")],
    config: ConfigFile,
    overrides: Overrides = None,
    task: OneTask = None,
    condition: OneCondition = None,
    seed: OneSeed = None,
    force: Annotated[bool, typer.Option("--force", help="Recompute even if the artifact is in the store.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run one stage of a configuration from inputs that are in the store."""
    from flows.commands.running import Part, run_stage

    run_stage(name, config, overrides or [], Part(task, condition, seed), force, as_json)


@app.command()
def explain(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Stage, e.g. train.")],
    config: ConfigFile,
    overrides: Overrides = None,
    task: OneTask = None,
    condition: OneCondition = None,
    seed: OneSeed = None,
    as_json: AsJson = False,
) -> None:
    """Say why a stage would be reused or computed."""
    from flows.commands.running import Part, explain_stage

    explain_stage(name, config, overrides or [], Part(task, condition, seed), as_json)


@app.command("ls")
def list_artifacts(
    kind: Annotated[str | None, typer.Argument(metavar="[KIND]", help="Kind of artifact; all if left out.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the artifacts in the store."""
    from flows.commands.looking import list_kind

    list_kind(kind, as_json)


@app.command()
def show(artifact: ArtifactId, as_json: AsJson = False) -> None:
    """Describe an artifact: what made it, of what, and what it holds."""
    from flows.commands.looking import show_artifact

    show_artifact(artifact, as_json)


@app.command()
def lineage(artifact: ArtifactId, as_json: AsJson = False) -> None:
    """Draw what an artifact was made from."""
    from flows.commands.looking import show_lineage

    show_lineage(artifact, as_json)


@app.command()
def verify(
    artifact: Annotated[str | None, typer.Argument(metavar="[ID]", help="Artifact; all if left out.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check that artifacts are as they were written."""
    from flows.commands.looking import verify_artifacts

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
    from flows.commands.making import repair_artifact

    repair_artifact(artifact, files, as_json)


@app.command()
def evaluate(
    checkpoint: Annotated[str, typer.Argument(metavar="CHECKPOINT", help="Id of a checkpoint, or its first letters.")],
    episodes: Annotated[int, typer.Option("--episodes", "-n", min=1, help="Evaluation episodes.")] = 100,
    seed_start: Annotated[
        int, typer.Option("--seed-start", min=0, help="Position of the first initial state among those for evaluation.")
    ] = 0,
    randomness: Annotated[str, typer.Option("--randomness", help="Level of the initial states.")] = "low",
    task: Annotated[str | None, typer.Option("--task", help="Task, if the checkpoint was trained for several.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the success rate of a checkpoint."""
    from flows.commands.making import evaluate_checkpoint

    evaluate_checkpoint(checkpoint, task, episodes, seed_start, randomness, as_json)


@app.command()
def replay(
    episodes: Annotated[
        str, typer.Argument(metavar="EPISODES", help="Id of episodes or of an evaluation, or its first letters.")
    ],
    episode: Annotated[int, typer.Option("--episode", "-k", help="Which episode, counted from 0.")] = 0,
    video: Annotated[
        Path | None,
        typer.Option("--video", help="Video to write, EPISODES-EPISODE.mp4 if left out; stills go beside it as PNG."),
    ] = None,
    camera: Annotated[str, typer.Option("--camera", help="front, wrist or both, side by side.")] = "both",
    size: Annotated[
        str, typer.Option("--size", metavar="WIDTHxHEIGHT", help="Size of each camera's image in pixels.")
    ] = "480x360",
    speed: Annotated[float, typer.Option("--speed", min=0.1, max=100, help="Times faster than real time.")] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Make a video of any episode in the store, with step numbers and milestones."""
    from flows.commands.replaying import replay_episode

    replay_episode(episodes, episode, video, camera, size, speed, as_json)


@app.command()
def ui(
    prefect_port: Annotated[int | None, typer.Option(help="Port of Prefect's pages; a free one if left out.")] = None,
    mlflow_port: Annotated[int | None, typer.Option(help="Port of MLflow's pages; a free one if left out.")] = None,
    as_json: AsJson = False,
) -> None:
    """Serve Prefect's and MLflow's pages on this machine until Ctrl-C."""
    from flows.ui import serve_pages

    serve_pages(prefect_port, mlflow_port, as_json)


@app.command()
def serve() -> None:
    """Offer the flows and every stage as Prefect deployments, and run what is asked for, until Ctrl-C."""
    from flows.serve import serve_flows

    serve_flows()


def main() -> None:
    """Entry point: 0 on success, 1 after an error, 2 after a wrong call, 130 after Ctrl-C."""
    # A shell that starts a command in the background has it ignore the interrupt; a service manager sends the other.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    sys.exit(call(sys.argv[1:]))


def call(arguments: list[str]) -> int:
    """Run a command; gives its exit status."""
    draw_without_display()
    command = typer.main.get_command(app)
    try:
        status = command.main(arguments, prog_name="juicer", standalone_mode=False)
    except typer.TyperException as error:
        typer.echo(f"juicer: {error.format_message()}", err=True)
        return error.exit_code
    except JuicerError as error:
        typer.echo(f"juicer: {error}", err=True)
        return 1
    # Typer turns Ctrl-C into this status.
    if status == INTERRUPTED:
        typer.echo("juicer: interrupted; nothing is half-written, the same command continues the work", err=True)
    return status if isinstance(status, int) else 0


if __name__ == "__main__":
    main()
