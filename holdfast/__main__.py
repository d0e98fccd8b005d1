"""`python -m holdfast`."""

import sys

from holdfast import main

sys.exit(main())
