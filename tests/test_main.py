"""The list of what is here: every script with its summary, the robots, and what an extra lacks."""

import subprocess
import sys
from pathlib import Path

from saphari_drake import __main__ as listing

ROOT = Path(__file__).resolve().parents[1]


def test_every_experiment_is_listed_with_its_summary(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    assert listing.main() == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    summaries = {words[0]: words[1] for words in lines if len(words) == 2}
    for path in (ROOT / "diagrams").glob("*.py"):
        assert len(summaries[f"diagrams/{path.name}"]) > 20
    assert "7" in summaries["saphari_drake.lwr4()"]


def test_an_extra_names_what_it_lacks(monkeypatch, capsys):
    needs = ["drake>=1", "mcap-x>=1; extra == 'mcap'", 'a.b; platform_system == "Linux" and extra == "mcap"']
    monkeypatch.setattr(listing.metadata, "requires", lambda name: needs)
    monkeypatch.setattr(listing, "_installed", lambda package: package != "mcap-x")
    assert listing.extras() == {"mcap": ["mcap-x"]}
    listing.main()
    assert "without mcap-x: pip install 'saphari_drake[mcap]'" in capsys.readouterr().out


def test_it_runs_anywhere(tmp_path):
    """As a module, in a folder that holds nothing."""
    done = subprocess.run([sys.executable, "-m", "saphari_drake"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "robots:" in done.stdout and not done.stderr
