"""One template mesh deformed onto a scan.

Read in this order:

- `_flaws`: faces that are turned over or collapsed, and how they are mended
- `_draw`: the template drawn to the scan, round by round
- `_register`: checks, units, size and side, and what comes back
"""

from jfsf.apps.registration._draw import RegistrationSettings
from jfsf.apps.registration._register import Registration, register

__all__ = ["Registration", "RegistrationSettings", "register"]
