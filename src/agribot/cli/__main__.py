"""`python -m agribot.cli`, as `agribot`."""

import sys

from agribot.cli.main import main

sys.exit(main())
