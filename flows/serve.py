"""``juicer serve``: the flows and every stage as Prefect deployments, to be triggered and scheduled from Prefect."""

from __future__ import annotations

from typing import Any

from flows.commands.output import say
from flows.environment import API_VARIABLE, prepare_environment
from flows.settings import read_settings
from juicer.errors import ServiceUnavailable


def serve_flows() -> None:
    """Register the deployments and run what is asked for, until Ctrl-C.

    Raises:
        ServiceUnavailable: If no Prefect server is running.
    """
    if not prepare_environment(read_settings()):
        raise ServiceUnavailable(f"deployments need a Prefect server; start one with `juicer ui` or set {API_VARIABLE}")
    from prefect import serve

    from flows.collect_infer import collect_infer
    from flows.single_stage import single_stage
    from flows.study import study
    from stages.names import STAGES

    deployments: list[Any] = [
        collect_infer.to_deployment("loop", description="The whole loop for one model.", tags=["juicer"]),
        study.to_deployment("study", description="Conditions times seeds, compared.", tags=["juicer"]),
        *(
            single_stage.to_deployment(
                name, parameters={"stage": name}, description=f"Stage '{name}' of a configuration.", tags=["juicer"]
            )
            for name in STAGES
        ),
    ]
    for deployment in deployments:
        say(f"{deployment.flow_name}/{deployment.name}")
    say("waiting for runs; start one with `prefect deployment run collect_infer/loop`, Ctrl-C ends")
    serve(*deployments, print_starting_message=False)
