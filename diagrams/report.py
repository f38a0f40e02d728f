"""Run the experiments over seeds, record what they show and write the README's tables from it; or check against it.

`python diagrams/report.py --help` tells how.
"""

import sys
from pathlib import Path

from experiments.evidence.command import Places, main

HERE = Path(__file__).resolve().parent

if __name__ == "__main__":
    places = Places(HERE, HERE.parent / "tests" / "benchmarks", HERE.parent / "README.md")
    sys.exit(main(None, places))
