"""Configurations of bridges for tests."""

from typing import Any

from autonomy.bridge.configuration import BridgeConfiguration


def bridge_configuration(**sections: Any) -> BridgeConfiguration:
    """Two columns, the first of which is SALT; sections given are laid over that, key by key."""
    base: dict[str, Any] = {
        "instrument": {"name": "probe", "endpoint": "udpin:127.0.0.1:5600"},
        "line": {"columns": 2},
        "values": {"SALT": {"field": 1}},
        "mavlink": {"endpoint": "udpout:127.0.0.1:14560"},
        "raw": {"enabled": False},
    }
    if "line" in sections:
        base["line"] = {}
    if "values" in sections:
        base["values"] = {}
    for name, section in sections.items():
        base[name] = {**base.get(name, {}), **section}
    return BridgeConfiguration.model_validate(base)
