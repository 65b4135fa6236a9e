"""Two clocks, for what must not depend on the time at which it is done."""

import time


def clocks(monkeypatch):
    """Yield twice, at two times of two years."""
    for year in (1999, 2031):
        then = time.strptime(f"{year} 02 03 04 05 06", "%Y %m %d %H %M %S")
        with monkeypatch.context() as patch:
            patch.setattr(time, "time", lambda then=then: time.mktime(then))
            patch.setattr(time, "localtime", lambda *_, then=then: then)
            patch.setattr(time, "asctime", lambda *_, year=year: f"in {year}")
            yield year
