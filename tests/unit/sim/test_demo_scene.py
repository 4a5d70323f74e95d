"""What the demo's vehicle says that it measures can be handed on: CF knows the name and the units."""

from pathlib import Path

from sim.demo_scene import open_sea, write_files


def test_the_made_up_salinity_has_the_name_and_the_units_of_cf(tmp_path: Path) -> None:
    _, configuration, _ = write_files(
        open_sea("synthetic-patch", None), tmp_path, {"vehicle": 1024, "shore": 1025}
    )
    assert (configuration.sensor.variable, configuration.sensor.units) == (
        "sea_water_practical_salinity",
        "1",
    )
