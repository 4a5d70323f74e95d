"""The pictures of docs/page.md: two simulated boats survey a made-up sea, and a browser looks at them meanwhile.

    python tests/browser/screenshots.py [SECONDS] [FOLDER]

takes as long as the boats sail (150 s of this machine's time), and writes PNG files below 300 kB.
"""

import contextlib
import importlib.util
import io
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from playwright.sync_api import Browser, FloatRect, sync_playwright

_HERE = Path(__file__).parent
sys.path[:0] = [str(_HERE.parent / "process"), str(_HERE.parents[1])]
from at_sea import operating  # noqa: E402
from processes import Processes, free_port, wait_until  # noqa: E402

from sim.demo_scene import READINGS_PER_SAMPLE, make_scene, open_sea, write_files  # noqa: E402

_SPEC = importlib.util.spec_from_file_location("browser_conftest", _HERE / "conftest.py")
assert _SPEC is not None
assert _SPEC.loader is not None
browser_conftest = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(browser_conftest)

BOATS = {"otter": "synthetic-patch", "grebe": "synthetic-patch:3"}
SPEEDUP = 300.0
_LARGEST_BYTES = 300_000
# Rare and small on a map, so that no choice of colours by their frequency keeps them: vessel, plan, fence.
_VIVID = ((255, 77, 61), (255, 176, 0), (255, 111, 97), (255, 255, 255))

VIEWS = {
    # name: fragment, width, height, theme, where the pointer is (shares of the first map)
    "page-light": ("#show=otter", 1440, 900, "light", (0.62, 0.55)),
    "page-dark": ("#show=otter", 1440, 900, "dark", None),
    "page-two-vehicles": ("#show=otter,grebe", 1600, 900, "dark", None),
    "page-phone": ("#show=otter", 390, 844, "light", None),
}


def launch(processes: Processes, folder: Path, name: str, spec: str, shore_port: int, seconds: float) -> str:
    """Start a vessel and its service; the endpoint at which an operator finds the vessel."""
    folder.mkdir()
    ports = {"vehicle": free_port(), "operator": free_port(), "shore": shore_port}
    sea = open_sea(spec, None)
    file, configuration, survey = write_files(sea, folder, ports)
    scene = make_scene(sea, survey, configuration.sampling.spacing_m, seconds * SPEEDUP)
    settings = yaml.safe_load(file.read_text())
    settings["vehicle"]["name"] = name
    file.write_text(yaml.safe_dump(settings, sort_keys=False))
    lat_deg, lon_deg = scene.start_deg
    operator = f"tcp:127.0.0.1:{ports['operator']}"
    interval_s = scene.spacing_m / scene.speed_mps / READINGS_PER_SAMPLE
    processes.vessel(
        *("--field", spec, "--shrink-to-m", "15000", f"--start={lat_deg:.7f},{lon_deg:.7f}"),
        *(
            "--speedup",
            f"{SPEEDUP:g}",
            "--speed-mps",
            f"{scene.speed_mps:.3f}",
            "--noise",
            f"{scene.noise:.6g}",
        ),
        *("--current=0.15,-0.10", "--sample-interval-s", f"{interval_s:.3f}"),
        *("--listen", f"udpout:127.0.0.1:{ports['vehicle']}", "--listen", operator),
    )
    processes.service(file)
    return operator


def of_few_colours(image: Image.Image, smooth: list[FloatRect]) -> Image.Image:
    """The picture in 256 colours, half its bytes: those of the text exactly, those of the maps mixed from 170."""
    inside = np.zeros((image.height, image.width), dtype=bool)
    for box in smooth:
        left, top = max(0, round(box["x"])), max(0, round(box["y"]))
        inside[top : top + round(box["height"]), left : left + round(box["width"])] = True
    pixels = np.array(image)
    of_text = [colour for colour, _ in Counter(map(tuple, pixels[~inside].tolist())).most_common(70)]
    of_maps = Image.fromarray(pixels[inside][None]).quantize(170, kmeans=1).getpalette() or []
    palette = [level for colour in (*of_text, *_VIVID) for level in colour] + of_maps[: 3 * 170]
    holder = Image.new("P", (1, 1))
    holder.putpalette((palette + [0] * 768)[:768])
    result = image.quantize(palette=holder, dither=Image.Dither.NONE)
    dithered = image.quantize(palette=holder, dither=Image.Dither.FLOYDSTEINBERG)
    result.paste(dithered, mask=Image.fromarray(inside.astype(np.uint8) * 255))
    return result


def look(browser: Browser, url: str, name: str, folder: Path) -> None:
    """Take one picture."""
    fragment, width, height, scheme, pointer = VIEWS[name]
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = context.new_page()
    page.goto(url + fragment)
    count = 2 * (fragment.count(",") + 1)
    page.locator('.map-canvas[data-drawn="now"]').nth(count - 1).wait_for(state="attached")
    page.wait_for_timeout(1500)
    if pointer is not None:
        box = page.locator(".surface").first.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + pointer[0] * box["width"], box["y"] + pointer[1] * box["height"])
        page.locator('.probe[data-source="predict"]').wait_for()
    picture = folder / f"{name}.png"
    smooth = [each.bounding_box() for each in page.locator(".surface, .bar").all()]
    image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    of_few_colours(image, [box for box in smooth if box is not None]).save(picture, optimize=True)
    size = picture.stat().st_size
    print(f"{picture}: {size / 1000:.0f} kB")
    assert size <= _LARGEST_BYTES, f"{picture} is larger than {_LARGEST_BYTES} bytes"
    context.close()


def main(seconds: float, folder: Path) -> None:
    """Sail, and look when half is sailed."""
    with contextlib.ExitStack() as stack:
        processes = stack.enter_context(Processes())
        station = browser_conftest.Station(processes)
        work = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="halocline-pictures-")))
        operators = [
            stack.enter_context(operating(launch(processes, work / name, name, spec, station.port, seconds)))
            for name, spec in BOATS.items()
        ]
        wait_until(lambda: all(each.started for each in operators), 180.0, "the boats' start")
        time.sleep(0.4 * seconds)
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(
            executable_path=browser_conftest.find(), args=browser_conftest.FLAGS
        )
        for name in VIEWS:
            look(browser, station.url, name, folder)
        browser.close()


if __name__ == "__main__":
    main(
        float(sys.argv[1]) if len(sys.argv) > 1 else 150.0,
        Path(sys.argv[2]) if len(sys.argv) > 2 else _HERE.parents[1] / "docs" / "images",
    )
