"""On the path of a program, there is no matplotlib for it: a picture takes longer than a short run."""

import sys

sys.modules["matplotlib"] = None
