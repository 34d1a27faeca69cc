"""Asking a camera over HTTP: with its password, which is in no sentence, and past the environment's proxies."""

import time

import httpx

from foundation.errors import CameraError, UsageError
from hil.cameras.address import shown

CONNECT_S = 5.0


class Caller:
    """One camera's HTTP address, with a connection that is kept."""

    def __init__(self, url: str) -> None:
        """Raises UsageError for an address that is none."""
        self.name = shown(url)
        try:
            self._url = httpx.URL(url)
        except httpx.InvalidURL:
            self._url = httpx.URL("")
        if not self._url.host:
            raise UsageError(
                f"camera {self.name!r} is no http address: write special characters of a password as %XX, "
                "for example %40 for @"
            )
        self._auth: httpx.Auth | None = None  # None: what the address says, by the basic scheme
        # a camera stands in the same network: a proxy set for the internet would only be in the way
        self._http = httpx.Client(trust_env=False)

    def get(self, read_s: float, params: dict[str, int] | None = None) -> httpx.Response:
        """Return the answer with its body still to be read; the caller closes it. Raises CameraError.

        `read_s` is how long the camera may be silent.
        """
        response = self._send(read_s, params)
        challenge = response.headers.get("www-authenticate", "").lower()
        if response.status_code == 401 and challenge.startswith("digest") and self._auth is None and self._url.username:
            response.close()
            self._auth = httpx.DigestAuth(self._url.username, self._url.password)
            response = self._send(read_s, params)
        if response.status_code != 200:
            try:
                said = " ".join(response.read()[:120].decode("utf-8", "replace").split())
            except httpx.HTTPError:
                said = ""
            finally:
                response.close()
            raise CameraError(f"it answered {response.status_code} {said}".rstrip())
        return response

    def _send(self, read_s: float, params: dict[str, int] | None) -> httpx.Response:
        request = self._http.build_request(
            "GET", self._url, params=params, timeout=httpx.Timeout(read_s, connect=CONNECT_S)
        )
        try:
            return self._http.send(request, stream=True, auth=self._auth or httpx.USE_CLIENT_DEFAULT)
        except httpx.HTTPError as error:
            raise CameraError(shown(str(error)) or type(error).__name__) from None

    def close(self) -> None:
        self._http.close()


def body(response: httpx.Response, bytes_max: int) -> tuple[float, bytes]:
    """Return the host's monotonic second at which the first bytes of the body came, and the body.

    Raises CameraError when it breaks off or is larger than `bytes_max`.
    """
    parts: list[bytes] = []
    began_s, size = time.monotonic(), 0
    try:
        for chunk in response.iter_bytes():
            if not parts:
                began_s = time.monotonic()
            parts.append(chunk)
            size += len(chunk)
            if size > bytes_max:
                raise CameraError("it sent more than a picture can have")
    except httpx.HTTPError as error:
        raise CameraError(f"it broke off: {type(error).__name__}") from None
    finally:
        response.close()
    return began_s, b"".join(parts)
