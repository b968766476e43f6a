"""Hides matplotlib from a program with this directory in PYTHONPATH: a picture takes longer than a short run."""

import sys

sys.modules["matplotlib"] = None
