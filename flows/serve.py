"""``juicer serve``: the flows and every stage as Prefect deployments, to be triggered and scheduled from Prefect."""

from __future__ import annotations

import os
from typing import Any

from flows.commands.output import say
from flows.environment import API_VARIABLE, PASSWORD_VARIABLE, prepare_environment
from flows.servers.flow_runs import mark_crashed
from flows.settings import PREFIX, read_settings
from juicer.errors import ServiceUnavailable

SPREAD_VARIABLE = f"{PREFIX}SPREAD"


def serve_flows() -> None:
    """Register the deployments and run what is asked for, until Ctrl-C.

    Raises:
        ServiceUnavailable: If no Prefect server is running.
    """
    settings = read_settings()
    if not prepare_environment(settings):
        raise ServiceUnavailable(f"deployments need a Prefect server; start one with `juicer ui` or set {API_VARIABLE}")
    mark_crashed(settings.folder, os.environ[API_VARIABLE], os.environ.get(PASSWORD_VARIABLE))
    # Whoever serves does not send on: two machines would wait for each other.
    os.environ[SPREAD_VARIABLE] = "false"
    from prefect import serve
    from prefect.types.entrypoint import EntrypointType

    from flows.collect_infer import collect_infer
    from flows.make import make
    from flows.single_stage import single_stage
    from flows.spread import DEPLOYMENT
    from flows.study import study
    from stages.names import STAGES

    # Machines that serve share the deployments, but not the folder that juicer lies in.
    common: Any = {"tags": ["juicer"], "entrypoint_type": EntrypointType.MODULE_PATH}
    deployments: list[Any] = [
        make.to_deployment(DEPLOYMENT, description="Stages of runs on other machines.", **common),
        collect_infer.to_deployment("loop", description="The whole loop for one model.", **common),
        study.to_deployment("study", description="Conditions times seeds, compared.", **common),
        *(
            single_stage.to_deployment(
                name, parameters={"stage": name}, description=f"Stage '{name}' of a configuration.", **common
            )
            for name in STAGES
        ),
    ]
    for deployment in deployments:
        # `serve` does so too, but only after the last word: whoever reads that may rely on it.
        deployment.apply()
        say(f"{deployment.flow_name}/{deployment.name}")
    say("waiting for runs; start one with `prefect deployment run collect_infer/loop`, Ctrl-C ends")
    # Schedules are the team's, and outlive the machine that leaves.
    serve(*deployments, print_starting_message=False, pause_on_shutdown=False, limit=settings.workers)
