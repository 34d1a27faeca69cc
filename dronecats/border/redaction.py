"""Keeps keys and passwords out of sentences and files."""

import re

_USER = re.compile(r"(?<=://)[^/@\s]*@")


def redacted(text: str, *secrets: str | None) -> str:
    """Return `text` without the user part of any URL in it and without any of the given secrets."""
    for secret in secrets:
        if secret:
            text = text.replace(secret, "***")
    return _USER.sub("***@", text)
