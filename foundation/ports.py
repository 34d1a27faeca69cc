"""Who holds a local port."""


def port_holder(protocol: str, port: int) -> str | None:
    """Return 'name (process id N)' of the program that holds a local port, None when that cannot be known.

    `protocol`: 'UDP' or 'TCP'.
    """
    try:
        import psutil

        for connection in psutil.net_connections(protocol.lower()):
            if connection.laddr and connection.laddr.port == port and connection.pid:
                return f"{psutil.Process(connection.pid).name()} (process id {connection.pid})"
    except Exception:  # psutil is optional, and looking at other people's processes may be refused
        return None
    return None
