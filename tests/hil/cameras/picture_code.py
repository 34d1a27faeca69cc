"""Pictures that carry a number: sixteen black or white squares, readable after any compression.

Nothing here needs more than Python, so that a server in another interpreter can draw them too.
"""

BITS, SIDE = 16, 16  # squares, px each
WIDTH, HEIGHT = BITS * SIDE, 144  # px


def drawn(number: int) -> bytes:
    """Return a WIDTH × HEIGHT picture of three bytes per pixel that carries number modulo 2**BITS."""
    code = b"".join((b"\xf0" if number >> bit & 1 else b"\x10") * (3 * SIDE) for bit in range(BITS))
    return code * SIDE + b"\x80" * (3 * WIDTH * (HEIGHT - SIDE))


def read(picture) -> int:
    """Return the number that an (H, W, 3) picture carries."""
    middle = picture[SIDE // 2, SIDE // 2 :: SIDE, 1]
    return sum(1 << bit for bit in range(BITS) if middle[bit] > 128)
