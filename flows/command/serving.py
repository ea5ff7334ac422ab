"""Commands that serve something until Ctrl-C."""

from __future__ import annotations

from typing import Annotated

import typer

from flows.command.arguments import AsJson
from flows.command.options import CommandLine

app = CommandLine()


@app.command()
def ui(
    prefect_port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Port of Prefect's pages; a free one if left out."),
    ] = None,
    mlflow_port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Port of MLflow's pages; a free one if left out."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Serve Prefect's and MLflow's pages on this machine until Ctrl-C."""
    from flows.servers.ui import serve_pages

    serve_pages(prefect_port, mlflow_port, as_json)


@app.command()
def pages(
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="Port; 8000 or a free one if left out.")] = None,
    as_json: AsJson = False,
) -> None:
    """Serve the pages for people on this machine until Ctrl-C: artifacts, episodes, lineage."""
    from flows.command.pages import serve_pages

    serve_pages(port, as_json)


@app.command()
def server(
    name: Annotated[str, typer.Argument(metavar="NAME", help="prefect or mlflow.")],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="Port; the usual one if left out.")] = None,
) -> None:
    """Run one of the two servers for a team, behind a guard and with a password; see docs/team.md."""
    from flows.servers.team import serve_one

    serve_one(name, host, port)


@app.command()
def serve() -> None:
    """Offer the flows and every stage as Prefect deployments, and run what is asked for, until Ctrl-C."""
    from flows.servers.serve import serve_flows

    serve_flows()
