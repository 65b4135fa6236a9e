"""Records that programs exported by `jax.export` take and return."""

from dataclasses import asdict
from json import dumps, loads
from typing import Any, TypeVar

from jax import export

R = TypeVar("R", bound=type)


def exported(record: R) -> R:
    """Let `jax.export` write programs that take or return this NamedTuple.

    The name that stands in the file is the package's and the class's, wherever the
    class is defined.
    """
    export.register_namedtuple_serialization(
        record, serialized_name=f"jfsf.{record.__name__}"
    )
    return record


def exported_dataclass(record: R, **of_static: Any) -> R:
    """The same for a frozen dataclass that is a pytree.

    Args:
        record: registered by `jax.tree_util.register_dataclass`.
        of_static: for each static field, in their order, what makes it of what JSON
            holds of it: `float`, say, or a function of a dict for a dataclass.
    """

    def write(values: Any) -> bytes:
        plain = [v if isinstance(v, bool | int | float) else asdict(v) for v in values]
        return dumps(plain).encode()

    def read(text: bytes) -> tuple[Any, ...]:
        pairs = zip(of_static.values(), loads(bytes(text)), strict=True)
        return tuple(make(value) for make, value in pairs)

    export.register_pytree_node_serialization(
        record,
        serialized_name=f"jfsf.{record.__name__}",
        serialize_auxdata=write,
        deserialize_auxdata=read,
    )
    return record
