"""``python -m ruffini``: the command without its script."""

import sys

from ruffini.commands import main

sys.exit(main())
