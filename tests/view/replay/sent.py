"""The messages of a page, as received by a second viewer. Every viewer gets the same ones."""

from typing import Any

from benchmarks.page_client import PageClient

QUIET_S = 0.5  # s; after such a pause, all messages have arrived


class Sent:
    """All messages of a page, in their order."""

    def __init__(self, url: str) -> None:
        self._client = PageClient(url)
        self.messages: list[dict[str, Any]] = []

    def update(self) -> list[dict[str, Any]]:
        """Read all pending messages, and return all messages so far."""
        while came := self._client.receive(QUIET_S):
            self.messages += came
        return self.messages

    def newest(self, kind: str, name: str) -> dict[str, Any]:
        """Return the newest message of a kind about a node. Raises LookupError without one."""
        messages = [message for message in self.update() if message["type"] == kind and message.get("name") == name]
        return messages[-1]

    def text(self) -> str:
        """Return all text of the page: names of nodes, labels, HTML."""
        return "\n".join(word for message in self.update() for word in _words(message))

    def close(self) -> None:
        """Read all pending messages, then disconnect. With unread messages the disconnection would block."""
        self.update()
        self._client.close()


def _words(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    return [word for one in inner for word in _words(one)]
