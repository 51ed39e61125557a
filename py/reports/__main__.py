"""Reports: ``python py/reports NAME`` makes one, ``python py/reports --pages`` all pages anew.

``--help`` after a name tells what it measures and its options. JSON, pages and pictures are written
to ``tests/reports``, those of ``--quick`` to ``target/reports/quick``.
"""

import sys

from engine.command import main

if __name__ == "__main__":
    main(sys.argv[1:])
