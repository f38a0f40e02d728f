"""Tell what a robot's model file lacks, how its arm is understood, and which experiments it can do.

`python diagrams/check_robot.py --help` tells more.
"""

import sys
from pathlib import Path

from experiments.placement.check import main

if __name__ == "__main__":
    sys.exit(main(None, Path(__file__).resolve().parent))
