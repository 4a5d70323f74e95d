"""What the bridge reads: its configuration, an instrument's lines, and their recording."""

from typing import Any

from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.bridge.lines import LineSplitter
from autonomy.bridge.recorded import RecordingError, read_recorded
from autonomy.bridge.translator import Translator
from autonomy.config import ConfigurationError

from .decoder import JSON_TOKENS, ROOT, YAML_TOKENS, Decoder, reader_of, scratch


def bridged() -> list[BridgeConfiguration]:
    """Bridges for each of the three shapes of a line."""
    link, values = (
        {"endpoint": "udpout:127.0.0.1:14560"},
        {"field": 2, "response_s": 2.0, "response": "sharpen"},
    )
    shapes: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({"columns": 4}, values),
        ({"pattern": r"t1=\s*(?P<t>-?\d+\.\d{4}),(?P<rest>.*)*"}, values | {"field": "t"}),
        ({"sentence": "MTW", "decimal": ","}, values | {"field": 1}),
    ]
    return [
        BridgeConfiguration.model_validate(
            {
                "instrument": {"endpoint": "serial:/dev/ttyUSB0:9600", "data_bits": 7 + number % 2},
                "line": line,
                "values": {"SALT": value},
                "mavlink": link,
            }
        )
        for number, (line, value) in enumerate(shapes)
    ]


def read_lines(data: bytes) -> None:
    """As a bridge does, cut in two, as a port might hand it over."""
    for configuration in bridged():
        splitter, translator = LineSplitter(is_stream=True), Translator(configuration)
        for piece in (b"\n", data[: len(data) // 2], data[len(data) // 2 :]):
            for line in splitter.add(piece):
                translator.take(0.0, line)


def lines() -> list[bytes]:
    return [
        b"17.1234,  4.21345,    1.052,  33.5124\r\n17.1235,  4.21346,    1.053,  33.5125\r\n",
        b"t1= 23.7658, c1= 0.00019, s1= 0.0084\r\n",
        b"$YXMTW,17,75,C*5D\r\n$GPGLL,4916.45,N,12311.12,W,225444,A*31\r\n",
    ]


def read_recording(data: bytes) -> None:
    path = scratch("raw.ndjson")
    path.write_bytes(data)
    for _ in read_recorded(path):
        pass


DECODERS = {
    "bridge": Decoder(
        reader_of("bridge.yaml", load_bridge),
        lambda: [file.read_bytes() for file in sorted((ROOT / "config" / "bridge").glob("*.yaml"))],
        (ConfigurationError,),
        YAML_TOKENS,
    ),
    "lines": Decoder(
        read_lines, lines, (), [b"\r", b"\n", b",", b"*", b"$", b"t1=", b"9" * 400, b"e999", b"\xff"]
    ),
    "recorded lines": Decoder(
        read_recording,
        lambda: [b'{"bridge": "0.1"}\n{"host_s": 1.5, "line": "33.5, 1"}\n', *lines()],
        (RecordingError,),
        JSON_TOKENS,
    ),
}
