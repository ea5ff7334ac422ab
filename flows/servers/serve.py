"""``juicer serve``: the flows and every stage as Prefect deployments, to be triggered and scheduled from Prefect."""

from __future__ import annotations

import os
from typing import Any

from flows.running.data_folder import open_store
from flows.running.device import check_device
from flows.running.flow_runs import mark_crashed
from flows.running.settings import PREFIX, read_settings
from flows.servers.acquaintance import check_prefect
from flows.servers.environment import API_VARIABLE, PASSWORD_VARIABLE, prepare_environment
from flows.terminal.output import say
from juicer.errors import ServiceUnavailable


def serve_flows() -> None:
    """Register the deployments and run what is asked for, until Ctrl-C.

    Raises:
        ServiceUnavailable: If no Prefect server is running, or it cannot be used.
    """
    settings = read_settings()
    check_device(settings)
    if not prepare_environment(settings):
        raise ServiceUnavailable(f"deployments need a Prefect server; start one with `juicer ui` or set {API_VARIABLE}")
    check_prefect(os.environ[API_VARIABLE])
    mark_crashed(settings.folder, os.environ[API_VARIABLE], os.environ.get(PASSWORD_VARIABLE))
    # Flow runs are processes of their own, which Prefect may start in another folder: places are told as absolute ones.
    os.environ |= {f"{PREFIX}DATA": str(settings.folder), f"{PREFIX}STORE": open_store(settings).url}
    from prefect import serve
    from prefect.types.entrypoint import EntrypointType

    from flows.deployed import configured, configured_stage, loop, stage_of_loop, study

    # Prefect's page sorts them by these names.
    offered: list[tuple[Any, str, str]] = [
        (loop, "loop", "run"),
        (study, "study", "run"),
        (configured, "configuration", "run"),
        (stage_of_loop, "stage", "stage"),
        (configured_stage, "stage-of-configuration", "stage"),
    ]
    deployments: list[Any] = [
        each.to_deployment(
            name,
            tags=["juicer", tag],
            description=(each.description or "").partition("\n")[0],
            # Machines that serve share the deployments, but not the folder that juicer lies in.
            entrypoint_type=EntrypointType.MODULE_PATH,
        )
        for each, name, tag in offered
    ]
    for deployment in deployments:
        # `serve` does so too, but only after the last word: whoever reads that may rely on it.
        deployment.apply()
        say(f"{deployment.flow_name}/{deployment.name}")
    say(
        "waiting for runs; start one on Prefect's page or with `prefect deployment run collect_infer/loop`, Ctrl-C ends"
    )
    # Schedules are the team's, and outlive the machine that leaves.
    serve(*deployments, print_starting_message=False, pause_on_shutdown=False, limit=settings.workers)
