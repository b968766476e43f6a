"""Prints the resident memory in MiB after so many evaluations of the fish swarm, and after ten times as many more."""

from __future__ import annotations

import json
import os
import sys

from hil.bench.process import memory_of
from hil.bench.swarm import ours
from hil.bench.zigzag import zigzag


def main() -> None:
    """Swim twice, the second time ten times as long."""
    evaluations = int(sys.argv[1])
    log = zigzag()
    found = []
    ours(log, 1000, 0, 1)
    for times in (1, 10):
        ours(log, times * evaluations, 1, 1)
        found.append(memory_of(os.getpid()).now_mib)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
