"""On the path of a program, it is one on a computer without matplotlib: a run's picture takes longer than a short run."""

import sys

sys.modules["matplotlib"] = None
