"""A network that says where on a person each vertex of a shape lies.

Learned diffusion (Sharp et al., 2022, "DiffusionNet"): each block diffuses its channels
by heat for learned times, compares their gradients in the tangent plane, and mixes all
at each vertex. Gradients are compared with those turned by a right angle about the
outward normal too, so left and right differ.

The answer is a probability of each of some hundred anchors on the template, so a vertex
that may lie on either hand says so.
"""

from functools import cache
from importlib.resources import files

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jfsf.learned._inputs import NetworkInput

CHANNELS, BLOCKS = 96, 4
SLOPES = 0.05  # gradients of a shape of area 1 are some 20 times as large as values
WEIGHTS = "people.npz"
DISTANCES = "distances"  # in that file, beside the weights in their order


class Block(eqx.Module):
    """One round of diffusion."""

    log_times: Float[Array, " c"]
    real: Float[Array, "c c"]
    turned: Float[Array, "c c"]
    first: eqx.nn.Linear
    second: eqx.nn.Linear
    norm: eqx.nn.LayerNorm

    def __init__(self, channels: int, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 5)
        self.log_times = jax.random.uniform(keys[0], (channels,), minval=-8, maxval=-1)
        scale = 1 / jnp.sqrt(channels)
        self.real = scale * jax.random.normal(keys[1], (channels, channels))
        self.turned = scale * jax.random.normal(keys[2], (channels, channels))
        self.first = eqx.nn.Linear(3 * channels, channels, key=keys[3])
        self.second = eqx.nn.Linear(channels, channels, key=keys[4])
        self.norm = eqx.nn.LayerNorm(channels)

    def __call__(
        self, x: Float[Array, "n c"], shape: NetworkInput
    ) -> Float[Array, "n c"]:
        own = jax.vmap(self.norm)(x)
        coefficients = shape.evecs.T @ (shape.mass[:, None] * own)
        times = jnp.exp(self.log_times)
        coefficients *= jnp.exp(-shape.evals[:, None] * times[None])
        spread = shape.evecs @ coefficients
        a, b = (SLOPES * shape.slopes[:, i] @ coefficients for i in range(2))
        real = a @ self.real - b @ self.turned
        turned = a @ self.turned + b @ self.real
        products = jnp.tanh(a * real + b * turned)
        mixed = jnp.concatenate([own, spread, products], 1)
        mixed = jax.nn.gelu(jax.vmap(self.first)(mixed))
        return x + jax.vmap(self.second)(mixed)


class Network(eqx.Module):
    """Logits of the anchors at each vertex."""

    enter: eqx.nn.Linear
    blocks: list[Block]
    norm: eqx.nn.LayerNorm
    leave: eqx.nn.Linear

    def __init__(self, inputs: int, anchors: int, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, BLOCKS + 2)
        self.enter = eqx.nn.Linear(inputs, CHANNELS, key=keys[0])
        self.blocks = [Block(CHANNELS, one) for one in keys[2:]]
        self.norm = eqx.nn.LayerNorm(CHANNELS)
        self.leave = eqx.nn.Linear(CHANNELS, anchors, key=keys[1])

    def __call__(self, shape: NetworkInput) -> Float[Array, "n a"]:
        x = jax.vmap(self.enter)(shape.inputs)
        for block in self.blocks:
            x = block(x, shape)
        return jax.vmap(self.leave)(jax.vmap(self.norm)(x))


@cache
def trained() -> Network:
    """With the weights of `WEIGHTS`, which `experiments/learn/train.py` made."""
    leaves = [values for name, values in _numbers().items() if name != DISTANCES]
    inputs, anchors = leaves[0].shape[1], len(leaves[-1])
    empty = eqx.filter_eval_shape(Network, inputs, anchors, jax.random.key(0))
    return jax.tree.unflatten(jax.tree.structure(empty), leaves)


def anchor_distances() -> Float[np.ndarray, "a a"]:
    """Geodesic distances between the anchors on the template, in sqrt(area)."""
    return _numbers()[DISTANCES]


@cache
def _numbers() -> dict[str, np.ndarray]:
    with np.load(str(files("jfsf.learned") / WEIGHTS)) as file:
        return {name: file[name].astype(np.float32) for name in file.files}
