"""One template mesh deformed onto a scan.

Read in this order:

- `_settings`: the tuned numbers
- `_start`: size and side of the template, read from a map
- `_scan`: the nearest point of a scan that faces alike
- `_flaws`: faces that are turned over or collapsed
- `_unfold`: corners of those that stay so are moved
- `_draw`: the template drawn to the scan, round by round
- `_register`: checks, units, and what comes back
"""

from jfsf.apps.registration._register import Registration, register
from jfsf.apps.registration._settings import RegistrationSettings

__all__ = ["Registration", "RegistrationSettings", "register"]
