"""Areas as people draw them: GeoJSON, QGroundControl's plans, KML and KMZ."""

import io
import json
import zipfile
from collections.abc import Callable
from typing import Any

from autonomy.planning.errors import SurveyError
from autonomy.planning.polygon_files import Role, read_polygons

from .decoder import JSON_TOKENS, Decoder, reader_of

RING = [[-118.6, 33.4], [-118.4, 33.4], [-118.4, 33.6], [-118.6, 33.6], [-118.6, 33.4]]


def geojson() -> list[bytes]:
    polygon = {
        "type": "Polygon",
        "coordinates": [RING, [[-118.5, 33.5], [-118.49, 33.5], [-118.49, 33.51], [-118.5, 33.5]]],
    }
    many = {"type": "MultiPolygon", "coordinates": [[RING]]}
    features = [
        {"type": "Feature", "id": 3, "properties": {"name": "bay"}, "geometry": each}
        for each in (polygon, many)
    ]
    return [
        json.dumps(each).encode()
        for each in (polygon, features[0], {"type": "FeatureCollection", "features": features})
    ]


def qgc_plans() -> list[bytes]:
    corners = [[lat, lon] for lon, lat in RING[:-1]]
    fence = {
        "version": 2,
        "polygons": [{"inclusion": True, "polygon": corners, "version": 1}],
        "circles": [{"inclusion": False, "circle": {"center": [33.5, -118.5], "radius": 200}, "version": 1}],
    }
    survey = {"type": "ComplexItem", "complexItemType": "survey", "polygon": corners}
    plan = {"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "geoFence": fence}
    return [json.dumps(plan | {"mission": {"items": items}}).encode() for items in ([], [survey])]


def kml() -> list[bytes]:
    ring = " ".join(f"{lon},{lat},0" for lon, lat in RING)
    boundary = (
        f"<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
    )
    inside = f"<Document><Folder><Placemark><Polygon>{boundary}</Polygon></Placemark></Folder></Document>"
    head = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
    return [
        f"{head}{inside}</kml>".encode(),
        f"{head}{inside}</kml>".encode().replace(b"UTF-8", b"latin-1"),
    ]


def kmz_of(content: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", content)
    return out.getvalue()


def polygons(name: str, role: Role) -> Callable[[bytes], Any]:
    return reader_of(name, lambda path: read_polygons(path, role))


KML_TOKENS = [
    *b"< > </ &amp; &#x10ffff; <![CDATA[ <!-- ]]> <Polygon> </Polygon> <coordinates> <LineString> <a:b>".split(),
    *b'nan,inf 1e999,0 encoding="utf-16" encoding="punycode"'.split(),
    *(b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"<a>" * 60, b"9" * 5000, b"\x00", b"\xff\xfe"),
]


DECODERS = {
    "geojson": Decoder(polygons("a.geojson", "land"), geojson, (SurveyError,), JSON_TOKENS),
    "plan area": Decoder(polygons("a.plan", "area"), qgc_plans, (SurveyError,), JSON_TOKENS),
    "plan keep-out": Decoder(polygons("b.plan", "keep_out"), qgc_plans, (SurveyError,), JSON_TOKENS),
    "kml": Decoder(polygons("a.kml", "area"), kml, (SurveyError,), KML_TOKENS),
    "kmz": Decoder(polygons("a.kmz", "area"), kml, (SurveyError,), KML_TOKENS, kmz_of),
}
