"""The reasons for which a server ends a reply early, in words."""

REASONS = {  # of `Reply.finish`; {tokens} is the length of the reply
    "length": "cut off at {tokens} tokens: raise max_tokens or lower the reasoning",
    "refusal": "the model refused to answer",
    "filtered": "the provider's filter withheld the reply",
}


def ending_reason(finish: object, tokens_out: int | None) -> str | None:
    """Return why a reply is not all that the model had to say; None where its server gave no reason that is known."""
    reason = REASONS.get(finish) if isinstance(finish, str) else None
    return reason and reason.format(tokens="its limit of" if tokens_out is None else f"{tokens_out:,}")
