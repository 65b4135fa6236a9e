"""Records of arrays <-> torch tensors, numpy and jax arrays, through dlpack.

A record is any NamedTuple of arrays (or other pytree): `Mesh`, `Spectrum`, `Maps`,
`Match`. Each function takes arrays of all three kinds, mixed too, and returns the same
record with arrays of one. The type of the numbers stays. On one device nothing is
copied where the layout allows: then both records see the same memory, so write into
neither.
"""

from typing import Any, TypeVar

import jax
import numpy as np

from jfsf.apps.interop._packages import need

Record = TypeVar("Record")


def to_torch(record: Record) -> Record:
    """The record with torch tensors, each on the device where its array is.

    Raises:
        ImportError: torch is missing.
        ValueError: a field is no array of numbers.
    """
    torch = need("torch", "torch", "install it for your machine, as pytorch.org says")

    def convert(name, leaf):
        if isinstance(leaf, torch.Tensor):
            return leaf
        if not isinstance(leaf, jax.Array):
            leaf = _numbers("to_torch", name, leaf)
            # torch ends the process at a negative stride (faces[:, ::-1]).
            if any(stride < 0 for stride in leaf.strides):
                leaf = leaf.copy()
        return torch.from_dlpack(leaf)

    return _each(convert, record)


def to_numpy(record: Record) -> Record:
    """The record with numpy arrays; those of other devices are copied to the host.

    Raises:
        ValueError: a field is no array of numbers, or is a tensor that requires a
            gradient.
    """

    def convert(name, leaf):
        if _is_tensor(leaf):
            return np.from_dlpack(_constant("to_numpy", name, leaf).cpu())
        return _numbers("to_numpy", name, leaf)

    return _each(convert, record)


def to_jax(record: Record) -> Record:
    """The record with jax arrays, tensors each on its device.

    Raises:
        ValueError: as `to_numpy`, or a field has 64 bits and jax's x64 is off, where
            jax would halve them without a word.
    """

    def convert(name, leaf):
        tensor = _is_tensor(leaf)
        if not tensor and not isinstance(leaf, jax.Array):
            leaf = _numbers("to_jax", name, leaf)
        dtype = np.dtype(str(leaf.dtype).removeprefix("torch."))
        if jax.dtypes.canonicalize_dtype(dtype) != dtype:
            raise ValueError(
                f"to_jax: {name} is {dtype} and jax's x64 is off; cast it, or set "
                "jax_enable_x64"
            )
        if not tensor:
            return jax.numpy.asarray(leaf)
        # jax takes no strides but those of a transposition.
        return jax.dlpack.from_dlpack(_constant("to_jax", name, leaf).contiguous())

    return _each(convert, record)


def _each(convert, record) -> Any:
    return jax.tree_util.tree_map_with_path(
        lambda path, leaf: convert(jax.tree_util.keystr(path) or "the array", leaf),
        record,
    )


def _is_tensor(leaf):
    # Without an import of torch.
    return hasattr(leaf, "requires_grad")


def _constant(function: str, name: str, tensor: Any) -> Any:
    if tensor.requires_grad:
        raise ValueError(
            f"{function}: {name} requires a gradient, which ends here; pass its "
            ".detach()"
        )
    return tensor


def _numbers(function, name, leaf):
    array = np.asarray(leaf)
    if array.dtype.kind not in "fiub":
        raise ValueError(
            f"{function}: {name} is {type(leaf).__name__} of {array.dtype}; pass "
            "arrays of numbers"
        )
    return array
