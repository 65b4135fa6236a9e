"""Settings of the whole process, changed for a while by threads that overlap."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import Lock

from threadpoolctl import threadpool_limits


def shared_context(
    change: Callable[[], Iterator[None]],
) -> Callable[[], AbstractContextManager[None]]:
    """As `contextlib.contextmanager`, for threads that are in it at the same time.

    The first that comes changes the setting and the last that leaves sets it back. By
    itself each would set back what it found, which may be what another had changed.

    Args:
        change: changes it, yields once, and sets it back.
    """
    lock, inside, make = Lock(), [], contextmanager(change)

    @contextmanager
    def entered() -> Iterator[None]:
        with lock:
            if not inside:
                context = make()
                context.__enter__()
                inside.append(context)
            inside.append(inside[0])
        try:
            yield
        finally:
            with lock:
                inside.pop()
                if len(inside) == 1:
                    inside.pop().__exit__(None, None, None)

    return entered


@shared_context
def one_blas_thread() -> Iterator[None]:
    """While BLAS has one thread: small products gain nothing by more."""
    with threadpool_limits(1, user_api="blas"):
        yield
