"""One flight, from its spec to a judged folder."""
