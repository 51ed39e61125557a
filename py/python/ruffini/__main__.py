"""``python -m ruffini``: the ``ruffini`` command without its script."""

import sys

from ruffini.commands import main

sys.exit(main())
