"""Images that encode a number as 16 black or white squares, readable after lossy compression.

Drawing uses only the standard library, because a server in another interpreter imports this module, too.
"""

BITS, SIDE = 16, 16  # squares, px each
WIDTH, HEIGHT = BITS * SIDE, 144  # px


def drawn(number: int) -> bytes:
    """Return a WIDTH × HEIGHT image, three bytes per pixel, that encodes number modulo 2**BITS."""
    code = b"".join((b"\xf0" if number >> bit & 1 else b"\x10") * (3 * SIDE) for bit in range(BITS))
    return code * SIDE + b"\x80" * (3 * WIDTH * (HEIGHT - SIDE))


def read(picture) -> int:
    """Return the number that an (H, W, 3) image encodes."""
    middle = picture[SIDE // 2, SIDE // 2 :: SIDE, 1]
    return sum(1 << bit for bit in range(BITS) if middle[bit] > 128)
