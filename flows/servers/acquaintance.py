"""Whether what answers at an address is a Prefect server that this machine may use."""

from __future__ import annotations

from juicer.errors import ServiceUnavailable
from juicer.text import printable

UNAUTHORIZED = 401
PATIENCE_SECONDS = 15.0


def check_prefect(url: str) -> None:
    """Refuse a server that is none of Prefect's, or of another version, or that asks for another password.

    Raises:
        ServiceUnavailable: With the reason.
    """
    from prefect import get_client  # takes seconds; whoever asks is about to need it
    from prefect.exceptions import PrefectHTTPStatusError
    from prefect.settings import PREFECT_API_REQUEST_TIMEOUT, PREFECT_CLIENT_MAX_RETRIES, temporary_settings

    brief = {PREFECT_API_REQUEST_TIMEOUT: PATIENCE_SECONDS, PREFECT_CLIENT_MAX_RETRIES: 0}
    try:
        with temporary_settings(brief), get_client(sync_client=True) as client:
            client.raise_for_api_version_mismatch()
            client.read_flows(limit=1)
    except Exception as error:  # whatever an unknown program answers
        cause = error.__cause__ or error
        if isinstance(cause, PrefectHTTPStatusError) and cause.response.status_code == UNAUTHORIZED:
            reason = "it asks for another password; set PREFECT_API_AUTH_STRING to its own, as USER:PASSWORD"
        else:
            first = str(cause).strip().partition("\n")[0] or type(cause).__name__
            reason = f"{printable(first)}; see whether PREFECT_API_URL names it, and to its log"
        raise ServiceUnavailable(f"the Prefect server at '{printable(url)}' cannot be used: {reason}") from None
