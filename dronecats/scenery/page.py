"""The server behind a page of this machine: started and stopped without a word of its own, for nobody else to see."""

import contextlib
import io
import logging

import viser

HOST = "127.0.0.1"  # whoever can open a page can do what it offers: this machine only


class LoopbackServer(viser.ViserServer):
    """viser's server without its way out: a page cannot ask it for a public address."""

    def __init__(self, label: str, port: int) -> None:
        """Serve a page of this name on a port, or on the next one that is free. Raises OSError where none is."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=HOST, port=port, label=label, verbose=False)
        logging.getLogger("websockets").setLevel(logging.CRITICAL)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.get_port()}"

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing."""

    def stop(self) -> None:
        """Close the page; browsers that show it say so."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser says goodbye on standard output
            super().stop()
