"""A standard name is written where it is one of CF's, held against the table that the compliance checker brings."""

from pathlib import Path
from xml.etree import ElementTree

import compliance_checker
import pytest

from autonomy.export.netcdf import STANDARD_NAMES, measured


def test_the_names_are_in_the_table_of_cf() -> None:
    table = ElementTree.parse(
        Path(compliance_checker.__file__).parent / "data" / "cf-standard-name-table.xml"
    )
    assert {entry.get("id") for entry in table.iter("entry")} >= STANDARD_NAMES


@pytest.mark.parametrize("variable", ["salinity", "salt", "chlor"])
def test_a_name_that_is_none_of_cf_is_a_long_name_only(variable: str) -> None:
    assert measured(variable, "1") == {"long_name": variable, "units": "1"}


def test_a_name_of_cf_is_written() -> None:
    assert measured("sea_water_temperature", "degC", "standard_error") == {
        "standard_name": "sea_water_temperature standard_error",
        "long_name": "sea water temperature standard error",
        "units": "degC",
    }
