"""The command `jfsf`, which is `python -m jfsf`.

An interrupt (Ctrl-C) ends the process at once, with exit code 130. It does not become a
KeyboardInterrupt, which is lost in too many places: numpy catches one that comes while
it is imported, and is broken from then on; what jax runs at each garbage collection
cannot raise it; and an import that it ends may leave a lock for which others wait.
`jfsf batch` and `jfsf collection` say what is kept, too (`jfsf.apps.cli._runs`).
"""

import os
import signal
import sys

INTERRUPTED = 130


def main() -> None:
    """The entry point."""
    # In the background a shell has it ignored: that stays.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    # XLA reads it when it is loaded, here and in workers, and says much that is not for
    # users: to it "Very slow compile?" is an error. What ends the process is said.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    # numpy and jax, so only now.
    from jfsf.apps.cli import main

    main()


def _end(*_: object) -> None:
    """Remove files that are being written, show the cursor, and end the process."""
    try:
        if "jfsf.storage._atomic" in sys.modules:
            sys.modules["jfsf.storage._atomic"].remove_unfinished()
        if os.isatty(2):
            os.write(2, b"\x1b[?25h\n")  # a status line hides it
    finally:
        # While storage is imported it has no such function, but no such files either.
        os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
