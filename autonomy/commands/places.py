"""Places as people type them on a command line."""

import argparse


def place(text: str) -> tuple[float, float]:
    """Latitude and longitude in degrees; raises ArgumentTypeError."""
    try:
        lat_deg, lon_deg = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be LATITUDE,LONGITUDE in degrees (got {text!r})") from None
    if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 360.0):
        raise argparse.ArgumentTypeError(f"no such place: latitude {lat_deg:g}, longitude {lon_deg:g}")
    return lat_deg, lon_deg
