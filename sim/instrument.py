"""The simulated instrument's own port: lines of text, as real instruments write them, in place of MAVLink."""

from sim.endpoints import Callbacks, Client, Endpoint, OpenEndpoint, open_endpoint

_SHOWN = 33.5


def line_format(text: str) -> str:
    """A line with `{value}` in it, which may say how it is written: `t1= 17.0000, s1= {value:.4f}`.

    Raises:
        ValueError: it has no value in it, or another field.
    """
    try:
        said = text.format(value=_SHOWN), text.format(value=2.0 * _SHOWN)
    except (KeyError, IndexError, AttributeError) as error:
        raise ValueError(f"{text!r}: knows only {{value}}, not {error}") from error
    if said[0] == said[1]:
        raise ValueError(f"{text!r}: must hold {{value}}, or {{value:.4f}}")
    return text


class TextPort:
    """Writes a line for each reading to whoever listens, and reads nothing.

    Args:
        endpoint: `udpout` sends unprompted, `tcp` serves as a serial server does.
        line: see `line_format`.
    """

    def __init__(self, endpoint: Endpoint, line: str) -> None:
        self.endpoint = endpoint
        self._line = line
        self._clients: dict[Client, None] = {}
        self._open: OpenEndpoint | None = None

    async def open(self) -> None:
        """Open the port; `endpoint` has its real number then. Raises OSError."""
        callbacks = Callbacks(self._joined, lambda client, data: None, self._left)
        self._open = await open_endpoint(self.endpoint, callbacks)
        self.endpoint = self._open.endpoint

    @property
    def has_listeners(self) -> bool:
        """Whether anybody is there to be written to."""
        return bool(self._clients)

    def close(self) -> None:
        """Close it."""
        if self._open is not None:
            self._open.close()

    def say(self, value: float) -> None:
        """A reading; its line ends with a carriage return and a line feed."""
        line = f"{self._line.format(value=value)}\r\n".encode("ascii", "replace")
        for client in list(self._clients):
            client.send([line])

    def _joined(self, client: Client) -> None:
        self._clients[client] = None

    def _left(self, client: Client) -> None:
        self._clients.pop(client, None)
