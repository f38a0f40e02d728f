"""The page of what is recorded: whole, without a network, and as a real browser shows it."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from experiments.evidence.page import NAME, distribution, write_page
from matplotlib.figure import Figure
from matplotlib.image import imread

from saphari_drake.simulation.record.files import write_text

METRIC = {"value": 0.3, "worst": 0.4, "unit": "m", "bound": [None, 0.35], "reported": "", "decides": True}
RESULTS = {
    "some_script": {
        "case": {
            "seeds": [0, 1],
            "plant": "ideal",
            "versions": {"drake": "1"},
            "metrics": {"error_m": METRIC, "late_m": {**METRIC, "value": 0.5}},
        }
    }
}
SUMMARY = """{"plan": {"script": "some_script", "case": "random"}, "trials": 3, "met": 2, "rate": [0.67, 0.2, 0.9],
"failing": [1], "metrics": {"speed": {"quantiles": [0, 0.1, 0.4, 1.2, 2], "worst": 2.0, "worst_trial": 1,
"bound": [null, 1.0]}}}"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with a figure, a sweep and a replay of Meshcat."""
    from pydrake.geometry import Meshcat, Rgba, Sphere

    folder = tmp_path_factory.mktemp("page")
    for name in ("run", "sweep"):
        (folder / name).mkdir()
    figure = Figure((2.0, 1.0))
    figure.subplots().plot([0.0, 1.0])
    figure.savefig(folder / "run" / "figure.png")
    write_text(folder / "sweep" / "summary.json", SUMMARY)
    meshcat = Meshcat()
    meshcat.SetObject("ball", Sphere(0.5), Rgba(1.0, 0.0, 0.0))
    write_text(folder / "run" / "replay.html", meshcat.StaticHtml())
    return write_page(RESULTS, {}, folder)


def test_it_tells_values_verdicts_and_rates_and_asks_for_nothing_from_a_network(page):
    text = page.read_text(encoding="utf-8")
    assert page.name == NAME and "error_m" in text and "2 of 3 trials" in text
    assert text.count('class="FAIL"') == 2 and text.count('class="pass"') == 1
    assert not re.search(r"""(src|href)=["'](https?:)?//""", text)
    assert text.count("<img") == 1 and text.count("<iframe") == 1 and text.count('class="distribution"') == 1


def test_distributions_rise_from_the_least_to_the_largest_value():
    points = re.search(r'points="([^"]+)"', distribution([0.0, 0.5, 4.0], [None, 2.0])).group(1)
    x, y = np.array([pair.split(",") for pair in points.split()], dtype=float).T
    assert np.all(np.diff(x) > 0.0) and np.all(np.diff(y) < 0.0)


def test_a_browser_shows_it(page, tmp_path):
    """Figures, the picture that WebGL draws, and an empty console."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    picture = tmp_path / "page.png"
    options = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
               "--enable-logging=stderr", "--virtual-time-budget=8000", "--window-size=1100,1500",
               f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={picture}"]  # fmt: skip
    done = subprocess.run([browser, *options, page.as_uri()], capture_output=True, text=True, timeout=120)
    if not picture.is_file():
        pytest.skip(f"Chromium cannot run here: {done.stderr.strip().splitlines()[-1:]}")
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not console
    colors = imread(picture)[..., :3]
    red = (colors[..., 0] > 0.5) & (colors[..., 1] < 0.35) & (colors[..., 2] < 0.35)
    assert red.sum() > 2000, "the red ball of the replay"
    blue = (colors[..., 2] > 0.5) & (colors[..., 0] < 0.3)
    assert blue.sum() > 50, "the lines of figure and distribution"
