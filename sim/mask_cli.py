"""`sim mask`: the land of a field as GeoJSON, the only way in which the vessel ever learns of it."""

import argparse
import json
import sys
from pathlib import Path

from autonomy.option_types import not_negative
from sim.field import FieldError, open_field, shrunk
from sim.land import feature_collection, land_polygons


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim mask`."""
    parser.add_argument(
        "field",
        metavar="FIELD",
        help="NetCDF file, synthetic[:SEED], synthetic-patch[:SEED] or synthetic-moving[:SEED]",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the GeoJSON file to write")
    parser.add_argument("--variable", metavar="NAME", help="which variable of the file (land may differ)")
    parser.add_argument(
        "--simplify",
        type=not_negative("metres"),
        default=0.0,
        metavar="M",
        help="straighten the shore, erring seaward by at most 2 M metres (default: exact cells)",
    )
    parser.add_argument(
        "--shrink-to-m",
        type=not_negative("metres"),
        metavar="M",
        help="shrink a larger field to this size first",
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the polygons; exit codes: 0 written, 1 cannot write the file, 2 cannot open the field."""
    try:
        field = open_field(arguments.field, arguments.variable)
    except FieldError as error:
        print(f"sim mask: {error}", file=sys.stderr)
        return 2
    if arguments.shrink_to_m:
        field = shrunk(field, arguments.shrink_to_m)
    land = land_polygons(field, arguments.simplify)
    try:
        arguments.out.write_text(json.dumps(feature_collection(land, "land")) + "\n", encoding="utf-8")
    except OSError as error:
        print(f"sim mask: {arguments.out}: cannot be written: {error.strerror or error}", file=sys.stderr)
        return 1
    vertices = sum(len(ring.coords) for part in land.geoms for ring in (part.exterior, *part.interiors))
    print(
        f"{field.info.description}\n{arguments.out}: {len(land.geoms)} polygons of land, {vertices} vertices"
    )
    return 0
