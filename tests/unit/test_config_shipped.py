"""The configurations and the documentation in the repository tell the truth."""

import math
from pathlib import Path
from typing import Any

import pytest
from pyproj import Geod

from autonomy.commands.show_config import yaml_value
from autonomy.config import Configuration, load
from autonomy.config.file import read_document
from autonomy.config.reference import KeyReference, keys
from autonomy.planning.survey import read_survey

REPOSITORY = Path(__file__).parents[2]
KEYS = list(keys(Configuration))


def at(data: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        data = data[part]
    return data


@pytest.mark.parametrize("file", sorted((REPOSITORY / "config").glob("*.yaml")), ids=lambda file: file.name)
def test_every_shipped_configuration_is_good_and_has_water(file: Path) -> None:
    survey = read_survey(load(file, {}).survey)
    assert survey.candidate_sites(4, 4).shape == (16, 2)


def test_default_yaml_has_every_key_with_its_default() -> None:
    file = REPOSITORY / "config" / "default.yaml"
    configuration = load(file, {})
    assert configuration == Configuration(survey={"area": configuration.survey.area})  # type: ignore[arg-type]
    data = read_document(file).data
    for key in KEYS:
        if key.path[:2] != ("model", "hyperparameters") and not key.required:
            default = list(key.default) if isinstance(key.default, tuple) else key.default
            assert at(data, key.path) == default, key.path
    assert data["model"]["hyperparameters"] is None


def test_default_yaml_says_what_every_key_means() -> None:
    text = " ".join((REPOSITORY / "config" / "default.yaml").read_text().replace("#", " ").split())
    for key in KEYS:
        if key.path[:2] != ("model", "hyperparameters"):
            assert key.meaning[1:] in text, f"{'.'.join(key.path)}: {key.meaning}"


def test_paper_yaml_is_the_papers_setting() -> None:
    configuration = load(REPOSITORY / "config" / "paper.yaml", {})
    model, estimation, exploration = configuration.model, configuration.estimation, configuration.exploration
    assert (model.capacity, model.novelty, model.centring_samples) == (100, 1e-3, 50)
    assert (estimation.objective, estimation.data, estimation.optimiser) == (
        "loo",
        "basis",
        "gradient_ascent",
    )
    assert not estimation.priors
    assert estimation.candidates == ("squared_exponential_ard",)
    assert (exploration.rho0, exploration.rho_rule, exploration.minimum_basis) == (0.6, "added", 1)
    assert exploration.maximum_interval_s is None
    assert not exploration.reestimate_on_path_end
    assert (configuration.planning.lattice, configuration.planning.spots) == ((12, 12), 20)


def test_lengths_in_paper_yaml_are_map_cells() -> None:
    configuration = load(REPOSITORY / "config" / "paper.yaml", {})
    assert isinstance(configuration.survey.area, list)
    lats, lons = zip(*configuration.survey.area, strict=True)
    dlat, dlon = (max(lats) - min(lats)) / 350, (max(lons) - min(lons)) / 390
    lat, lon = (max(lats) + min(lats)) / 2, (max(lons) + min(lons)) / 2
    ellipsoid = Geod(ellps="WGS84")
    east_m = ellipsoid.inv(lon - dlon / 2, lat, lon + dlon / 2, lat)[2]
    north_m = ellipsoid.inv(lon, lat - dlat / 2, lon, lat + dlat / 2)[2]
    by_hand = configuration.model.hyperparameters
    assert by_hand is not None
    assert by_hand.lengthscales_m == pytest.approx((math.e * east_m, math.e * north_m), rel=1e-5)
    assert by_hand.signal_variance == pytest.approx(math.exp(2))
    assert by_hand.noise_variance == pytest.approx(math.exp(-2))
    assert configuration.sampling.spacing_m == pytest.approx(math.sqrt(east_m * north_m), abs=0.1)


def row(key: KeyReference) -> str:
    """The key's line in the table of docs/configuration.md."""
    default = "required" if key.required else f"`{yaml_value(key.default)}`"
    return f"| `{'.'.join(key.path)}` | {key.meaning} | {key.unit} | {key.allowed} | {default} |"


@pytest.mark.parametrize("key", KEYS, ids=lambda key: ".".join(key.path))
def test_every_key_is_documented(key: KeyReference) -> None:
    assert row(key) in (REPOSITORY / "docs" / "configuration.md").read_text().splitlines()


def test_the_documentation_names_no_key_that_does_not_exist() -> None:
    lines = (REPOSITORY / "docs" / "configuration.md").read_text().splitlines()
    documented = [line for line in lines if line.startswith("| `")]
    assert documented == [row(key) for key in KEYS]


@pytest.mark.parametrize("key", KEYS, ids=lambda key: ".".join(key.path))
def test_every_key_has_a_meaning_and_its_name_carries_its_unit(key: KeyReference) -> None:
    assert key.meaning
    name = key.path[-1]
    suffix = {"m/s": "_mps", "Hz": "_hz", "s": "_s", "m": "_m"}.get(key.unit, "")
    assert name.endswith(suffix)
    for ending in ("_km", "_ms", "_seconds", "_kn", "_min"):
        assert not name.endswith(ending)
