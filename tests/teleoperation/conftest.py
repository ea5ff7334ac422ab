import pytest

from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.expert.operator import scripted_operators


@pytest.fixture(scope="session")
def one_leg_log() -> OperatorLog:
    """A success of the scripted operator."""
    return next(log for log in recordings("one_leg", "low", range(20), scripted_operators()) if log.success)
