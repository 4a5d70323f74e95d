"""What the bridge reads: its configuration, an instrument's lines, and their recording."""

from contextlib import suppress
from typing import Any

from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.bridge.lines import LineSplitter
from autonomy.bridge.patterns import LineError, Pattern, PatternError
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


def read_pattern(data: bytes) -> None:
    """No longer than a configuration may have it; what it makes of a line is no matter."""
    with suppress(LineError):
        Pattern(data.decode("utf-8", errors="replace")[:1000]).read("t1= 23.7658, c1= 0.00019, s1= 0.0084")


PATTERN_TOKENS = [
    *rb"( ) [ ] { } * + ? | ^ $ . , = - \ (?P<t> (?P=t) (?:a) (?i (?x) (?>a) (?=a) (?<=a) (?R) (?1) (?V1)".split(),
    *rb"\d \w \b \B \p{L} \N{DIGIT \X \R \L<a> {2} {9,} {e<=3} ){9} {99999} {,9} 9999999 \x \u \777 #".split(),
    *(b"\n", b" ", b"(" * 40, b")" * 40, b"(?:" * 40, b"){2}" * 40, b"\xc3\x9f"),
]


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
    "pattern": Decoder(
        read_pattern,
        lambda: [
            rb"t1=\s*(?P<t>-?\d+\.\d{4}),\s*c1=\s*(?P<c>-?\d+\.\d{5}),\s*s1=\s*(?P<s>-?\d+\.\d{4})",
            rb"(?ix)(?P<t> (?:[^,]*,\s?){2,12} ) (?>\w+|[^a-z\d]|\p{Lu})*? s1=\ (?P<s>[+-]?(?:\d+\.?|\.\d)\d*)",
        ],
        (PatternError,),
        PATTERN_TOKENS,
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
