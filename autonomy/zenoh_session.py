"""Settings of `autonomy.endpoints` as zenoh wants them."""

import json
from typing import Any

import zenoh


def zenoh_config(settings: dict[str, Any]) -> zenoh.Config:
    """A configuration of zenoh from paths and values."""
    config = zenoh.Config()
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    return config
